"""Numbers that are computed once a job, by the same arithmetic as everything else that reaches the film."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.bsdf_kernels import luminance
from scenefold.render.precise_kernels import power_of


@njit(nogil=True, cache=True, error_model="numpy")
def linear_of_srgb() -> np.ndarray:  # type: ignore[type-arg]
    """float64[256]: linear values of sRGB bytes."""
    table = np.empty(256)
    for byte in range(256):
        value = byte / 255.0
        table[byte] = value / 12.92 if value <= 0.04045 else power_of((value + 0.055) / 1.055, 2.4)
    return table


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def emitter_power(corners, radiance):  # type: ignore[no-untyped-def]
    """Sum of luminance x area over emissive triangles, float32[n, 3, 3] and float32[n, 3], in order."""
    total = 0.0
    for i in range(corners.shape[0]):
        ax, ay, az = np.float64(corners[i, 0, 0]), np.float64(corners[i, 0, 1]), np.float64(corners[i, 0, 2])
        ux, uy, uz = corners[i, 1, 0] - ax, corners[i, 1, 1] - ay, corners[i, 1, 2] - az
        vx, vy, vz = corners[i, 2, 0] - ax, corners[i, 2, 1] - ay, corners[i, 2, 2] - az
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = 0.5 * math.sqrt(nx * nx + ny * ny + nz * nz)
        total += area * luminance(float(radiance[i, 0]), float(radiance[i, 1]), float(radiance[i, 2]))
    return total
