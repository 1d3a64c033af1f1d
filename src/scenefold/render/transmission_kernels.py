"""Transmission that scatters: rough thin walls, and the boundaries of solid glass (specs/09-renderer-contract.md, *Glass*). In lanes.

KHR_materials_transmission and KHR_materials_volume. Straight transmission of smooth thin walls is the caster's (see_through_kernels.py).
Of a material that is transmission T and base colour c, light comes from the other side of

- a thin wall by the reflection lobe, mirrored through the surface, of what the layer does not reflect. With i' for i mirrored:

      T c ( D V(o, i') (1 - F(o.h)) + (1 - M) (1 - E(o)) (1 - E(i')) / (pi (1 - Eavg)) )

  Together with what the surface reflects, a white wall gives on all that it gets (energy_kernels.py);
- a solid body's boundary by refraction (refraction_kernels.py), times T c; what it mirrors, times T, is part of the same lobe, and
  what lies below counts 1 - T. The lobe is divided by what one bounce gives on of light from the viewer (glass_energy_kernels.py): so
  white glass gives on all that it gets, on either side.

Sides are those of the geometric normal; where the shading normal disagrees, there is no light.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.render.arrays import Feature, MaterialColumn
from scenefold.render.bsdf_kernels import (
    frame_of,
    grazing_of,
    into_frame,
    luminance,
    out_of_frame,
    reflect_ggx,
    sample_cosine,
    sample_visible_normal,
)
from scenefold.render.energy_kernels import Rough, albedo_of, bounced, left_of, rough_of
from scenefold.render.ggx_albedo import ALPHA_MIN
from scenefold.render.glass_energy_kernels import kept_by_glass
from scenefold.render.lane_values_kernels import alike, any_lane, bits_of, gather, select
from scenefold.render.math_kernels import INVERSE_PI
from scenefold.render.refraction_kernels import rough_dielectric, sample_rough_dielectric

_IOR, _ROUGH = MaterialColumn.IOR, np.uint32(Feature.ROUGH_TRANSMISSION)
_IOR_MIN = 1.0 + 2.0**-10
"""With an index of 1 a boundary would neither reflect nor bend, and its density would have no number. One of no more is as smooth as any,
so that it is not seen, however rough it is said to be: facets that do not bend light hide none of it either."""
_PICK_MIN, _PICK_MAX = 0.1, 0.95


class Transmission(NamedTuple):
    """A surface's transmission as it is seen from where the ray comes."""

    pick: Any
    """With which probability directions are drawn from it; 0 where there is none."""
    glass: Any
    """How much of the surface is solid glass: 1 - that is left of what lies below. 0 of a thin wall."""
    tint: Any
    """T c, three colours."""
    wo: Any
    """Towards the viewer, in the frame."""
    frame: Any
    """Nine reals: two tangents and the normal."""
    geometric: Any
    """The geometric normal, on the viewer's side."""
    alpha: Any
    eta: Any
    """Index on the far side by that on the viewer's."""
    rough: Any
    layer: Any
    """A thin wall's reflectance at normal incidence and at grazing angles, its strongest channel."""
    whole: Any
    """By which one bounce on glass is multiplied, so that nothing is lost."""
    more: Any
    """What passes a thin wall after several bounces, by (1 - E(i)); without T and c."""
    glossy: Any
    """Which share of a thin wall's directions is drawn from visible normals; the others by the cosine."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def scatters_through(surface):  # type: ignore[no-untyped-def]
    """Whether light of a `Surface` comes from the other side, and not only straight on."""
    thin = ((surface.features & _ROUGH) != np.uint32(0)) & (surface.transmission * (1.0 - surface.metallic) > 0.0)
    return thin | (surface.glass > 0.0)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def transmission_of(r, g, b, metallic, alpha, reflection, thin, glass, ior, behind, normal, geometric, way):  # type: ignore[no-untyped-def]
    """The `Transmission` of a base colour, seen along `way`. thin: a rough wall's transmission; glass: the share that is solid glass.

    reflection: the dielectric's at normal incidence, three colours, and at grazing angles. behind: seen from the back, where solid glass
    is the inside. Normals are on the viewer's side.
    """
    nx, ny, nz = normal
    ax, ay, az, bx, by, bz = frame_of(nx, ny, nz)
    frame = (ax, ay, az, bx, by, bz, nx, ny, nz)
    wo = into_frame(frame, -way[0], -way[1], -way[2])
    passes = thin * (1.0 - metallic)
    share = passes + glass
    strongest, f90, rough = max(reflection[0], max(reflection[1], reflection[2])), reflection[3], rough_of(alpha)
    missing, grazing = albedo_of(rough, wo[2])
    again = bounced(strongest, f90, rough)
    left, bright = left_of(strongest, f90, again, missing, grazing), luminance(r, g, b)
    through = passes * bright * left
    others = (1.0 - metallic) * (1.0 - left + (1.0 - thin) * bright * left) + metallic * bright
    pick = select(passes > 0.0, min(max(through / max(through + others, 1e-9), _PICK_MIN), _PICK_MAX), glass)
    index = max(ior, _IOR_MIN)
    alpha = select((glass > 0.0) & (ior <= _IOR_MIN), ALPHA_MIN, alpha)
    eta = select(behind, 1.0 / index, index)
    solid, whole = glass > 0.0, alike(1.0, alpha)
    if any_lane(solid):
        whole = select(solid, 1.0 / kept_by_glass(alpha, wo[2], index, behind), whole)
    more = (1.0 - again) * missing * INVERSE_PI / rough.missing
    return Transmission(
        pick, glass, (share * r, share * g, share * b), wo, frame, geometric, alpha, eta, rough, (strongest, f90), whole, more, 1.0 - missing
    )  # fmt: skip


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _none(example):  # type: ignore[no-untyped-def]
    """In as many lanes as the example has."""
    zero = alike(0.0, example)
    three, nowhere = (zero, zero, zero), Rough(bits_of(zero), zero, zero, zero)
    nine = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    return Transmission(zero, zero, three, three, nine, three, zero, zero, nowhere, (zero, zero), zero, zero, zero)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _thin(seen, x, y, z):  # type: ignore[no-untyped-def]
    """(value without colour, density) of a thin wall for light from below: (x, y, z) in the frame, z < 0."""
    shine, density, cosine = reflect_ggx(seen.wo[0], seen.wo[1], seen.wo[2], x, y, -z, seen.alpha)
    missing, _ = albedo_of(seen.rough, -z)
    f0, f90 = seen.layer
    value = shine * (1.0 - (f0 + (f90 - f0) * grazing_of(cosine))) + seen.more * missing
    return value, seen.glossy * density - (1.0 - seen.glossy) * z * INVERSE_PI


@njit(error_model="numpy", _nrt=False, forceinline=True)
def transmitted(seen, wx, wy, wz, r, g, b, pdf, cosine):  # type: ignore[no-untyped-def]
    """(r, g, b, pdf, cosine >= 0) for light from w, on any side, from those of what lies below; these themselves where nothing passes."""
    x, y, z = into_frame(seen.frame, wx, wy, wz)
    side = wx * seen.geometric[0] + wy * seen.geometric[1] + wz * seen.geometric[2]
    above, beyond = (side > 0.0) & (z > 0.0), (side < 0.0) & (z < 0.0)
    value, density = alike(0.0, z), alike(0.0, z)
    solid = seen.glass > 0.0
    if any_lane(solid):
        of_glass, density_of_glass = rough_dielectric(seen.wo[0], seen.wo[1], seen.wo[2], x, y, z, seen.alpha, seen.eta)
        value, density = select(solid, seen.whole * of_glass, value), select(solid, density_of_glass, density)
    thin = (seen.pick > 0.0) & (seen.glass <= 0.0) & beyond
    if any_lane(thin):
        of_wall, density_of_wall = _thin(seen, x, y, z)
        value, density = select(thin, of_wall, value), select(thin, density_of_wall, density)
    there, kept, mirrored = seen.pick > 0.0, select(above, 1.0 - seen.glass, 0.0), select(above, seen.glass * value, 0.0)
    value = select(beyond, value, 0.0)
    mixed = select(above | beyond, seen.pick * density, 0.0) + select(above, (1.0 - seen.pick) * pdf, 0.0)
    return (
        select(there, kept * r + mirrored + seen.tint[0] * value, r),
        select(there, kept * g + mirrored + seen.tint[1] * value, g),
        select(there, kept * b + mirrored + seen.tint[2] * value, b),
        select(there, mixed, pdf),
        select(there, abs(z), cosine),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_transmission(seen, lobe, u, v):  # type: ignore[no-untyped-def]
    """(x, y, z, whether it is on the side where it belongs): a direction in the world, by three numbers in [0, 1)."""
    wox, woy, woz = seen.wo
    x, y, z, leaves = sample_rough_dielectric(wox, woy, woz, seen.alpha, seen.eta, lobe, u, v)
    thin = seen.glass <= 0.0
    if any_lane(thin):
        hx, hy, hz = sample_visible_normal(wox, woy, woz, seen.alpha, u, v)
        double = 2.0 * (wox * hx + woy * hy + woz * hz)
        cx, cy, cz = sample_cosine(u, v)
        off_normal = lobe < seen.glossy
        tx, ty, tz = (
            select(off_normal, double * hx - wox, cx),
            select(off_normal, double * hy - woy, cy),
            select(off_normal, double * hz - woz, cz),
        )
        x, y, z, leaves = select(thin, tx, x), select(thin, ty, y), select(thin, -tz, z), select(thin, tz > 0.0, leaves)
    wx, wy, wz = out_of_frame(seen.frame, x, y, z)
    return wx, wy, wz, leaves


@njit(error_model="numpy", _nrt=False, forceinline=True)
def seen(hit):  # type: ignore[no-untyped-def]
    """The `Transmission` of a `Hit`."""
    found, m = _none(hit.u), hit.surface
    there = scatters_through(m)
    if any_lane(there):
        found = transmission_of(
            m.r, m.g, m.b, m.metallic, m.alpha, m.reflection, select(there & (m.glass <= 0.0), m.transmission, 0.0), m.glass,
            gather(hit.scene.materials, (hit.material, _IOR)), hit.behind, hit.normal, hit.geometric, hit.way,
        )  # fmt: skip
    return found


@njit(error_model="numpy", _nrt=False, forceinline=True)
def value(found, wx, wy, wz, below):  # type: ignore[no-untyped-def]
    """(r, g, b, density, cosine) for light from w, on either side, together with what lies below."""
    r, g, b, pdf, cosine = below
    if any_lane(found.pick > 0.0):
        r, g, b, pdf, cosine = transmitted(found, wx, wy, wz, r, g, b, pdf, cosine)
    return r, g, b, pdf, cosine


draw = sample_transmission
