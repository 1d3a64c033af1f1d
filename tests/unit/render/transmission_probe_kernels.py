"""Loops over the kernels of transmission, so that tests can call them on arrays: walls and glass whose normal is z."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from scenefold.render import (
    absorption_kernels,
    glass_energy_kernels,
    metallic_roughness_kernels,
    refraction_kernels,
    transmission_kernels,
)
from scenefold.render.lane_values_kernels import put as _put
from scenefold.render.lane_values_kernels import take as _take
from scenefold.render.lanes_kernels import LANES
from unit.render.probe_kernels import _cosine, _visible_normal

_transmission, _transmitted, _sample = (
    transmission_kernels.transmission_of,
    transmission_kernels.transmitted,
    transmission_kernels.sample_transmission,
)
_body, _evaluate = metallic_roughness_kernels.metallic_roughness, metallic_roughness_kernels.evaluate
_left_after, _fresnel = absorption_kernels.left_after, refraction_kernels.dielectric_fresnel
_kept_by_glass = glass_energy_kernels.kept_by_glass


@njit(error_model="numpy")
def _seen(wo: Any, base: Any, metallic: Any, alpha: Any, reflection: Any, thin: Any, glass: Any, ior: Any, behind: Any) -> Any:
    up = (0.0, 0.0, 1.0)
    over = _transmission(
        base[0], base[1], base[2], metallic, alpha, reflection, thin, glass, ior, behind, up, up, (-wo[0], -wo[1], -wo[2])
    )  # fmt: skip
    return over, _body(wo[0], wo[1], wo[2], base[0], base[1], base[2], metallic, alpha, reflection, thin)


@njit(error_model="numpy")
def evaluations(
    wo: Any, wi: Any, base: Any, metallic: Any, alpha: Any, reflection: Any, thin: Any, glass: Any, ior: Any, behind: Any
) -> Any:
    """f64[n, 5]: value, density and cosine for directions f64[n, 3] on both sides, towards f64[n, 3]."""
    out = np.empty((wi.shape[0], 5))
    for i in range(wi.shape[0]):
        over, body = _seen(wo[i], base, metallic, alpha, reflection, thin, glass, ior, behind)
        x, y, z = wi[i, 0], wi[i, 1], wi[i, 2]
        r, g, b, pdf = _evaluate(body, x, y, z)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = _transmitted(over, x, y, z, r, g, b, pdf, z)
    return out


@njit(error_model="numpy")
def scattered(
    wo: Any, base: Any, metallic: Any, alpha: Any, reflection: Any, thin: Any, glass: Any, ior: Any, behind: Any, numbers: Any
) -> Any:
    """Directions f64[n, 3] drawn as the shader does, from f64[n, 3]: lobe, u, v; (0, 0, 0) where there is none."""
    out = np.zeros((numbers.shape[0], 3))
    over, body = _seen(wo, base, metallic, alpha, reflection, thin, glass, ior, behind)
    for i in range(numbers.shape[0]):
        lobe, u, v = numbers[i, 0], numbers[i, 1], numbers[i, 2]
        if lobe < over.pick:
            x, y, z, leaves = _sample(over, lobe / over.pick, u, v)
        elif (lobe - over.pick) / (1.0 - over.pick) < body.pick:
            hx, hy, hz = _visible_normal(wo[0], wo[1], wo[2], alpha, u, v)
            cosine = 2.0 * (wo[0] * hx + wo[1] * hy + wo[2] * hz)
            x, y, z = cosine * hx - wo[0], cosine * hy - wo[1], cosine * hz - wo[2]
            leaves = z > 0.0
        else:
            x, y, z = _cosine(u, v)
            leaves = z > 0.0
        if leaves:
            out[i, 0], out[i, 1], out[i, 2] = x, y, z
    return out


@njit(error_model="numpy")
def kept_by_glass(alpha: Any, cosine: Any, index: Any, within: Any) -> Any:
    """f64[n], of f64[n] each."""
    out = np.empty(alpha.shape[0])
    for i in range(alpha.shape[0]):
        out[i] = _kept_by_glass(alpha[i], cosine[i], index[i], within)
    return out


@njit(error_model="numpy")
def _powers(color: Any, ways: Any, out: Any) -> None:
    for i in range(0, color.size, LANES):
        _put(out, i, _left_after(_take(color, i), _take(ways, i)))


def powers(color: Any, ways: Any) -> Any:
    """color^ways, in lanes."""
    count = len(color)
    room = np.zeros((3, -(-count // LANES) * LANES), np.float32)
    room[0, :count], room[1, :count] = color, ways
    _powers(*room)
    return room[2, :count].astype(np.float64)


@njit(error_model="numpy")
def reflectances(cosines: Any, eta: Any) -> Any:
    """f64[n, 2]: Fresnel's reflectance, and the cosine beyond."""
    out = np.empty((cosines.size, 2))
    for i in range(cosines.size):
        out[i, 0], out[i, 1] = _fresnel(cosines[i], eta)
    return out
