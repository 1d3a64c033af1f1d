"""What glTF's surface gives back, in numpy from the formulas of glTF 2.0, appendix B, and with all the light that these lose.

Directions are unit, f64[..., 3], in the surface's frame, z along the normal, and point away from it.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from scenefold.render import ggx_albedo
from scenefold.render.arrays import F64

F0 = 0.04
"""Of an index of refraction of 1.5."""
_ALPHA_LEAST = 1e-3


def fresnel(f0: F64 | float, cosine: F64 | float) -> F64:
    """Schlick's approximation."""
    result: F64 = f0 + (1.0 - np.asarray(f0)) * (1.0 - np.asarray(cosine)) ** 5
    return result


def specular(roughness: float, wo: F64, wi: F64) -> F64:
    """V D of the appendix, f64[...]: GGX with Smith's height-correlated visibility."""
    a2 = max(roughness**2, _ALPHA_LEAST) ** 2
    half = wo + wi
    half = half / np.sqrt((half**2).sum(axis=-1, keepdims=True))
    d = a2 / (math.pi * (half[..., 2] ** 2 * (a2 - 1.0) + 1.0) ** 2)
    o, i = wo[..., 2], wi[..., 2]
    result: F64 = d * 0.5 / (i * np.sqrt(o * o * (1 - a2) + a2) + o * np.sqrt(i * i * (1 - a2) + a2))
    return result


def value(base: F64, metallic: float, roughness: float, wo: F64, wi: F64, f0: float = F0) -> F64:
    """The BSDF without cosine, f64[..., 3]; both directions above the surface.

    Appendix B, but for two things (specs/09-renderer-contract.md): what a single bounce on the microfacets loses comes out after more of
    them, and the body has what the dielectric layer leaves of even light, both ways, not what it leaves along one pair of directions.
    """
    half = wo + wi
    half = half / np.sqrt((half**2).sum(axis=-1, keepdims=True))
    cosine = (wo * half).sum(axis=-1)[..., None]
    shine = specular(roughness, wo, wi)[..., None]
    single = shine * ((1.0 - metallic) * fresnel(f0, cosine) + metallic * fresnel(base, cosine))
    result: F64 = single + ggx_albedo.beside_one_bounce(base, metallic, roughness, f0, wo[..., 2], wi[..., 2])
    return result


def albedo(base: float, metallic: float, roughness: float, z: float, f0: float = F0) -> float:
    """Of even light, the share given back towards the cosine z."""
    o, mean = ggx_albedo.albedo(roughness, z), ggx_albedo.mean_albedo(roughness)
    left = float(ggx_albedo.left_of(f0, o, mean)[0])
    metal = base * (1.0 - o.missing) + (1.0 - base) * o.grazing + ggx_albedo.bounced(base, 1.0, mean.missing) * o.missing
    return (1.0 - metallic) * (1.0 - left + base * left) + metallic * float(metal)


@cache
def mean_albedo(base: float, metallic: float, roughness: float, f0: float = F0) -> float:
    """`albedo` over all viewers: cosine-weighted, as a sphere seen from far away shows them."""
    rows = 400
    return float(np.mean([albedo(base, metallic, roughness, math.sqrt((row + 0.5) / rows), f0) for row in range(rows)]))
