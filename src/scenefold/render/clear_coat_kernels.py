"""KHR_materials_clearcoat: a layer of varnish of index 1.5 on a surface (specs/09-renderer-contract.md). In lanes.

glTF mixes by the Fresnel term F of the angle between viewer and the coat's own normal: of strength c the coat mirrors c F, and what lies
below gives c F less; what comes through from the other side, too. The coat is GGX with a roughness and a normal of its own; values of a coated surface are

    f cos = (1 - c F) f_below cos_below + c F f_coat cos_coat

f_coat is GGX with all its bounces, which gives back whatever it gets (energy_kernels.py): under even light nothing is lost or gained.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import njit

from scenefold.render.arrays import MaterialColumn
from scenefold.render.bsdf_kernels import (
    frame_of,
    fresnel,
    into_frame,
    out_of_frame,
    reflect_ggx,
    sample_cosine,
    sample_visible_normal,
)
from scenefold.render.energy_kernels import Rough, albedo_of, rough_of
from scenefold.render.lane_values_kernels import alike, any_lane, bits_of, select
from scenefold.render.math_kernels import INVERSE_PI
from scenefold.render.normal_map_kernels import mapped_normal

_NORMAL_USE, _NORMAL_SCALE = MaterialColumn.CLEARCOAT_NORMAL_USE, MaterialColumn.CLEARCOAT_NORMAL_SCALE
_F0 = 0.04
_PICK_MIN, _PICK_MAX = 0.1, 0.9
_COSINE_MIN = 1e-4


class Coat(NamedTuple):
    """A coat as it is seen from where the ray comes."""

    share: Any
    """c F: how much of the light it mirrors; 0 where there is none."""
    pick: Any
    """With which probability directions are drawn from it."""
    alpha: Any
    frame: Any
    """Nine reals: two tangents and the normal."""
    wo: Any
    """Towards the viewer, in the frame."""
    rough: Any
    more: Any
    """What further bounces give back, by (1 - E(i)); without strength and F."""
    geometric: Any
    """The geometric normal, on the viewer's side."""
    glossy: Any
    """Which share of its directions is drawn from visible normals; the others by the cosine."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def coat_share(strength, cosine):  # type: ignore[no-untyped-def]
    """How much of the light a coat mirrors (lanes, or numbers)."""
    return strength * fresnel(_F0, 1.0, cosine)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def coat_of(strength, alpha, nx, ny, nz, dx, dy, dz, geometric):  # type: ignore[no-untyped-def]
    """The coat whose unit normal is n, as the geometric one on the viewer's side, for a ray along d."""
    ax, ay, az, bx, by, bz = frame_of(nx, ny, nz)
    frame = (ax, ay, az, bx, by, bz, nx, ny, nz)
    wo = into_frame(frame, -dx, -dy, -dz)
    share = coat_share(strength, wo[2])
    rough = rough_of(alpha)
    missing, _ = albedo_of(rough, wo[2])
    pick = select(strength > 0.0, min(max(share, _PICK_MIN), _PICK_MAX), 0.0)
    return Coat(share, pick, alpha, frame, wo, rough, missing * INVERSE_PI / rough.missing, geometric, 1.0 - missing)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def no_coat(example):  # type: ignore[no-untyped-def]
    """In as many lanes as the example has."""
    zero = alike(0.0, example)
    nowhere = Rough(bits_of(zero), zero, zero, zero)
    three, nine = (zero, zero, zero), (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    return Coat(zero, zero, zero, nine, three, nowhere, zero, three, zero)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _outside(coat, wx, wy, wz):  # type: ignore[no-untyped-def]
    """Whether w is on the viewer's side: a coat mirrors nothing to the other one, wherever its own normal looks."""
    return wx * coat.geometric[0] + wy * coat.geometric[1] + wz * coat.geometric[2] > 0.0


@njit(error_model="numpy", _nrt=False, forceinline=True)
def coated(coat, wx, wy, wz, r, g, b, pdf, cosine):  # type: ignore[no-untyped-def]
    """(r, g, b, pdf, cosine) of a coated surface for light from w, from those of what lies below; these themselves where there is no coat.

    The cosine is by which values are to be multiplied: the coat mirrors where the normal below is turned away, too.
    """
    x, y, z = into_frame(coat.frame, wx, wy, wz)
    value, density, _ = reflect_ggx(coat.wo[0], coat.wo[1], coat.wo[2], x, y, z, coat.alpha)
    missing, _ = albedo_of(coat.rough, z)
    value, density = value + coat.more * missing, coat.glossy * density + (1.0 - coat.glossy) * z * INVERSE_PI
    above = (coat.wo[2] > 0.0) & (z > 0.0) & _outside(coat, wx, wy, wz)
    there = coat.pick > 0.0
    divisor = max(cosine, _COSINE_MIN)
    added = select(above, coat.share * value * z, 0.0) / divisor
    kept = (1.0 - coat.share) * max(cosine, 0.0) / divisor
    return (
        select(there, r * kept + added, r),
        select(there, g * kept + added, g),
        select(there, b * kept + added, b),
        select(there, select(above, coat.pick * density, 0.0) + (1.0 - coat.pick) * pdf, pdf),
        select(there, divisor, cosine),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_coat(coat, lobe, u, v):  # type: ignore[no-untyped-def]
    """(x, y, z, whether it leaves the coat): a direction that the coat mirrors to the viewer, in the world. lobe: a number in [0, 1)."""
    hx, hy, hz = sample_visible_normal(coat.wo[0], coat.wo[1], coat.wo[2], coat.alpha, u, v)
    double = 2.0 * (coat.wo[0] * hx + coat.wo[1] * hy + coat.wo[2] * hz)
    x, y, z = double * hx - coat.wo[0], double * hy - coat.wo[1], double * hz - coat.wo[2]
    cx, cy, cz = sample_cosine(u, v)
    off_normal = lobe < coat.glossy
    x, y, z = select(off_normal, x, cx), select(off_normal, y, cy), select(off_normal, z, cz)
    wx, wy, wz = out_of_frame(coat.frame, x, y, z)
    return wx, wy, wz, (z > 0.0) & _outside(coat, wx, wy, wz)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def seen(hit):  # type: ignore[no-untyped-def]
    """The `Coat` of a `Hit`."""
    coat, surface = no_coat(hit.u), hit.surface
    if any_lane(surface.coat > 0.0):
        nx, ny, nz = mapped_normal(
            hit.scene, hit.material, hit.triangle, hit.instance, hit.u, hit.v, hit.places, hit.untilted, hit.geometric, hit.way,
            hit.behind, hit.scratch, _NORMAL_USE, _NORMAL_SCALE,
        )  # fmt: skip
        coat = coat_of(surface.coat, surface.coat_alpha, nx, ny, nz, hit.way[0], hit.way[1], hit.way[2], hit.geometric)
    return coat


@njit(error_model="numpy", _nrt=False, forceinline=True)
def value(coat, wx, wy, wz, below):  # type: ignore[no-untyped-def]
    """(r, g, b, density, cosine) for light from w, over what lies below."""
    r, g, b, pdf, cosine = below
    if any_lane(coat.pick > 0.0):
        r, g, b, pdf, cosine = coated(coat, wx, wy, wz, r, g, b, pdf, cosine)
    return r, g, b, pdf, cosine


draw = sample_coat
