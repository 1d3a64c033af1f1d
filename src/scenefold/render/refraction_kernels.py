"""What a rough boundary between air and glass mirrors and lets through: Walter et al., Microfacet Models for Refraction through Rough
Surfaces (EGSR 2007), with visible normals and Smith's height-correlated term. In lanes, or numbers.

Directions are in the shading frame and point away from the surface: `wo` above, `wi` above (mirrored) or below (refracted). eta is the index
on the far side by that on the side of `wo`: above 1 on the way into glass, below 1 on the way out.

What paths carry is radiance by the square of the index (basic radiance), which a boundary leaves as it is: so nothing is scaled here,
and through a closed body light comes out as if it had been.
"""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.bsdf_kernels import sample_visible_normal
from scenefold.render.lane_values_kernels import select
from scenefold.render.math_kernels import INVERSE_PI

_LEAST = 1e-30


@njit(error_model="numpy", _nrt=False, forceinline=True)
def dielectric_fresnel(cosine, eta):  # type: ignore[no-untyped-def]
    """(reflectance of unpolarised light, cosine of the refracted direction); (1, 0) where all is reflected. 0 <= cosine <= 1."""
    squared = 1.0 - (1.0 - cosine * cosine) / (eta * eta)
    refracts = squared > 0.0
    beyond = math.sqrt(select(refracts, squared, 0.0))
    crosswise = (cosine - eta * beyond) / (cosine + eta * beyond)
    lengthwise = (eta * cosine - beyond) / (eta * cosine + beyond)
    return select(refracts, 0.5 * (crosswise * crosswise + lengthwise * lengthwise), 1.0), beyond


@njit(error_model="numpy", _nrt=False, forceinline=True)
def rough_dielectric(wox, woy, woz, wix, wiy, wiz, alpha, eta):  # type: ignore[no-untyped-def]
    """(value, density): without cosine and colour, per steradian; 0 where no microfacet leads from wi to wo."""
    below = wiz < 0.0
    index = select(below, eta, 1.0)
    hx, hy, hz = wox + index * wix, woy + index * wiy, woz + index * wiz
    squared = hx * hx + hy * hy + hz * hz
    scale = select(hz < 0.0, -1.0, 1.0) / math.sqrt(max(squared, _LEAST))
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    towards, away = wox * hx + woy * hy + woz * hz, wix * hx + wiy * hy + wiz * hz
    reflected, _ = dielectric_fresnel(min(max(towards, 0.0), 1.0), eta)
    a2, cosine = alpha * alpha, abs(wiz)
    # D's denominator from the sine: 1 + cos^2 (alpha^2 - 1) would lose all its digits in single precision.
    d = hz * hz * a2 + (hx * hx + hy * hy)
    root_o = math.sqrt(woz * woz + a2 * (wox * wox + woy * woy))
    root_i = math.sqrt(wiz * wiz + a2 * (wix * wix + wiy * wiy))
    # The solid angle of half vectors by that of wi: 1 / (4 o.h), or eta^2 |i.h| / |o + eta i|^2; times 2 o.h here.
    spread = select(below, 2.0 * towards * abs(away) * eta * eta / max(squared, _LEAST), 0.5)
    common = select(below, 1.0 - reflected, reflected) * spread * a2 * INVERSE_PI / (d * d)
    good = (woz > 0.0) & (cosine > 0.0) & (towards > 0.0) & select(below, away < 0.0, away > 0.0)
    return (
        select(good, common / (root_o * cosine + root_i * woz), 0.0),
        select(good, common / (woz + root_o), 0.0),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_rough_dielectric(wox, woy, woz, alpha, eta, lobe, u, v):  # type: ignore[no-untyped-def]
    """(x, y, z, whether it is on the side where it belongs): mirrored or refracted by a visible microfacet; three numbers in [0, 1)."""
    hx, hy, hz = sample_visible_normal(wox, woy, woz, alpha, u, v)
    towards = min(max(wox * hx + woy * hy + woz * hz, 0.0), 1.0)
    reflected, beyond = dielectric_fresnel(towards, eta)
    mirrors = lobe < reflected
    of_normal = select(mirrors, 2.0 * towards, towards / eta - beyond)
    of_viewer = select(mirrors, -1.0, -1.0 / eta)
    x, y, z = of_normal * hx + of_viewer * wox, of_normal * hy + of_viewer * woy, of_normal * hz + of_viewer * woz
    return x, y, z, select(mirrors, z > 0.0, z < 0.0)
