"""What glTF's surface gives back, in numpy from the formulas of glTF 2.0, appendix B: what checks compare with.

Directions are unit, f64[..., 3], in the surface's frame, z along the normal, and point away from it.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from scenefold.render.arrays import F64

F0 = 0.04
"""Of an index of refraction of 1.5."""
_ALPHA_LEAST = 1e-3
_GRID = 96


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
    """The BSDF without cosine, f64[..., 3]; both directions above the surface."""
    half = wo + wi
    half = half / np.sqrt((half**2).sum(axis=-1, keepdims=True))
    cosine = (wo * half).sum(axis=-1)[..., None]
    shine = specular(roughness, wo, wi)[..., None]
    f_d = fresnel(f0, cosine)
    dielectric = (1.0 - f_d) * base / math.pi + f_d * shine
    result: F64 = (1.0 - metallic) * dielectric + metallic * shine * fresnel(base, cosine)
    return result


@cache
def albedo(base: float, metallic: float, roughness: float, z: float, f0: float = F0) -> tuple[float, float]:
    """Of even light, the share given back towards the cosine z: (single scattering, with all that it loses given back).

    What lies between both is a renderer's choice: microfacets that shadow one another lose light, and compensating for it is allowed.
    Quadrature over the distribution of half vectors for the specular part, over the cosine for the diffuse one.
    """
    steps = (np.arange(_GRID) + 0.5) / _GRID
    u, v = (axis.ravel() for axis in np.meshgrid(steps, steps))
    wo = np.array([math.sqrt(max(1.0 - z * z, 0.0)), 0.0, z])
    a2 = max(roughness**2, _ALPHA_LEAST) ** 2
    cosine = np.sqrt((1.0 - u) / (1.0 + (a2 - 1.0) * u))
    sine, angle = np.sqrt(1.0 - cosine**2), 2.0 * math.pi * v
    half = np.stack([sine * np.cos(angle), sine * np.sin(angle), cosine], axis=1)
    towards = half @ wo
    wi = 2.0 * towards[:, None] * half - wo
    good = (towards > 0) & (wi[:, 2] > 1e-9)
    wi, towards = np.where(good[:, None], wi, [0.0, 0.0, 1.0]), np.where(good, towards, 1.0)
    # V D cos / density, the density being D cos(half) / (4 wo.half).
    d = a2 / (math.pi * (cosine**2 * (a2 - 1.0) + 1.0) ** 2)
    weight = np.where(good, specular(roughness, wo, wi) * wi[:, 2] * 4.0 * towards / (d * cosine), 0.0)
    white = float(weight.mean())
    shining = float((weight * ((1 - metallic) * fresnel(f0, towards) + metallic * fresnel(base, towards))).mean())
    flat = np.stack([np.sqrt(u) * np.cos(angle), np.sqrt(u) * np.sin(angle), np.sqrt(1.0 - u)], axis=1)
    between = flat + wo
    between /= np.sqrt((between**2).sum(axis=1, keepdims=True))
    diffuse = float((1 - metallic) * base * (1.0 - fresnel(f0, between @ wo)).mean())
    return shining + diffuse, shining + diffuse + max(1.0 - white, 0.0)


@cache
def mean_albedo(base: float, metallic: float, roughness: float, f0: float = F0) -> tuple[float, float]:
    """`albedo` over all viewers: cosine-weighted, as a sphere seen from far away shows them."""
    rows = 40
    each = np.array([albedo(base, metallic, roughness, math.sqrt((row + 0.5) / rows), f0) for row in range(rows)])
    return float(each[:, 0].mean()), float(each[:, 1].mean())
