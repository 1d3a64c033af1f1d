"""glTF's metallic-roughness surface: Lambert's body under a dielectric GGX layer, mixed with a GGX metal. In lanes, or numbers.

The layer gives back S(o) = f0 (E - B) + f90 B + M (1 - E) of even light, several bounces and all (energy_kernels.py). What it leaves
goes to the body, both ways, and comes back with its colour c:

    f = D V F(V.H) + M (1 - E(o)) (1 - E(i)) / (pi (1 - Eavg))  +  c (1 - S(o)) (1 - S(i)) / (pi (1 - Savg))

So a white body gives back all that it gets, from any angle and at any roughness; and either way light takes the same value.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import njit

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
from scenefold.render.energy_kernels import albedo_of, bounced, left_of, rough_of
from scenefold.render.lane_values_kernels import any_lane, select
from scenefold.render.math_kernels import INVERSE_PI

_PICK_MIN = 0.1
_LEAST = 1e-6


class MetallicRoughness(NamedTuple):
    """A surface as it is seen from where the ray comes. Colours are three reals."""

    wo: Any
    """Towards the viewer, in the shading frame."""
    alpha: Any
    rough: Any
    f0: Any
    """Reflectance at normal incidence, of the mixture."""
    f90: Any
    """At grazing angles."""
    more: Any
    """What further bounces give back, by (1 - E(i))."""
    body: Any
    """What the body gives back, by what the layer leaves of light from i."""
    layer: Any
    """The layer's strongest channel: reflectance at normal incidence, at grazing angles, and by further bounces."""
    pick: Any
    """With which probability directions are drawn from visible normals, and not by the cosine."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _mixed(metallic, dielectric, metal):  # type: ignore[no-untyped-def]
    return (1.0 - metallic) * dielectric + metallic * metal


@njit(error_model="numpy", _nrt=False, forceinline=True)
def metallic_roughness(wox, woy, woz, base_r, base_g, base_b, metallic, alpha, reflection, transmission):  # type: ignore[no-untyped-def]
    """The `MetallicRoughness` of a base colour. reflection: the dielectric's at normal incidence, three colours, and at grazing angles.

    transmission: the share of what would go to the body that passes, and is no part of this.
    """
    d_r, d_g, d_b, d_90 = reflection
    rough = rough_of(alpha)
    missing, grazing = albedo_of(rough, woz)
    f0 = (_mixed(metallic, d_r, base_r), _mixed(metallic, d_g, base_g), _mixed(metallic, d_b, base_b))
    f90 = _mixed(metallic, d_90, 1.0)
    common = missing * INVERSE_PI / rough.missing
    more = (
        _mixed(metallic, bounced(d_r, d_90, rough), bounced(base_r, 1.0, rough)) * common,
        _mixed(metallic, bounced(d_g, d_90, rough), bounced(base_g, 1.0, rough)) * common,
        _mixed(metallic, bounced(d_b, d_90, rough), bounced(base_b, 1.0, rough)) * common,
    )
    # One colour's reflection takes no light from another's body: the strongest counts for all, as glTF has it.
    strongest = max(d_r, max(d_g, d_b))
    again = bounced(strongest, d_90, rough)
    left = (1.0 - metallic) * (1.0 - transmission) * left_of(strongest, d_90, again, missing, grazing)
    mean = max(left_of(strongest, d_90, again, rough.missing, rough.grazing), _LEAST)
    share = left * INVERSE_PI / mean
    body = (share * base_r, share * base_g, share * base_b)
    shine = luminance(f0[0], f0[1], f0[2]) * (1.0 - missing - grazing) + f90 * grazing
    flat = luminance(base_r, base_g, base_b) * left + luminance(more[0], more[1], more[2]) * (rough.missing / INVERSE_PI)
    total = shine + flat
    pick = select((total > 1e-12) & (flat > 0.0), min(max(shine / total, _PICK_MIN), 1.0), 1.0)
    return MetallicRoughness((wox, woy, woz), alpha, rough, f0, f90, more, body, (strongest, d_90, again), pick)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def evaluate(surface, wix, wiy, wiz):  # type: ignore[no-untyped-def]
    """(f_r, f_g, f_b, pdf): the value without cosine, and the density with which its `pick` draws wi.

    Both directions on the upper side, else all is 0.
    """
    wox, woy, woz = surface.wo
    shine, density, cosine = reflect_ggx(wox, woy, woz, wix, wiy, wiz, surface.alpha)
    missing, grazing = albedo_of(surface.rough, wiz)
    left = left_of(surface.layer[0], surface.layer[1], surface.layer[2], missing, grazing)
    pdf = surface.pick * density + (1.0 - surface.pick) * wiz * INVERSE_PI
    above = (woz > 0.0) & (wiz > 0.0)
    schlick, f90 = grazing_of(cosine), surface.f90
    f0_r, f0_g, f0_b = surface.f0
    return (
        select(above, shine * (f0_r + (f90 - f0_r) * schlick) + surface.more[0] * missing + surface.body[0] * left, 0.0),
        select(above, shine * (f0_g + (f90 - f0_g) * schlick) + surface.more[1] * missing + surface.body[1] * left, 0.0),
        select(above, shine * (f0_b + (f90 - f0_b) * schlick) + surface.more[2] * missing + surface.body[2] * left, 0.0),
        select(above, pdf, 0.0),
    )


class Seen(NamedTuple):
    """The body at a hit."""

    surface: Any
    frame: Any
    """Nine reals: two tangents and the normal."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def seen(hit):  # type: ignore[no-untyped-def]
    """The `Seen` of a `Hit`."""
    nx, ny, nz = hit.normal
    ax, ay, az, bx, by, bz = frame_of(nx, ny, nz)
    frame = (ax, ay, az, bx, by, bz, nx, ny, nz)
    wox, woy, woz = into_frame(frame, -hit.way[0], -hit.way[1], -hit.way[2])
    m = hit.surface
    return Seen(metallic_roughness(wox, woy, woz, m.r, m.g, m.b, m.metallic, m.alpha, m.reflection, m.transmission), frame)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def value(body, wx, wy, wz):  # type: ignore[no-untyped-def]
    """(r, g, b, density, cosine) for light from w."""
    x, y, z = into_frame(body.frame, wx, wy, wz)
    r, g, b, pdf = evaluate(body.surface, x, y, z)
    return r, g, b, pdf, z


@njit(error_model="numpy", _nrt=False, forceinline=True)
def draw(body, lobe, u, v):  # type: ignore[no-untyped-def]
    """(x, y, z, whether it leaves the surface), off visible normals or by the cosine."""
    x, y, z = sample_cosine(u, v)
    glossy = lobe < body.surface.pick
    if any_lane(glossy):
        wox, woy, woz = body.surface.wo
        hx, hy, hz = sample_visible_normal(wox, woy, woz, body.surface.alpha, u, v)
        double = 2.0 * (wox * hx + woy * hy + woz * hz)
        x, y, z = select(glossy, double * hx - wox, x), select(glossy, double * hy - woy, y), select(glossy, double * hz - woz, z)
    wx, wy, wz = out_of_frame(body.frame, x, y, z)
    return wx, wy, wz, z > 0.0
