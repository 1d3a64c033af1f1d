"""Rays in the job's box: spans, steps of t_done, and origins that do not hit their own surface.

A ray's span is where it crosses the job's box; t_done counts 65,535 steps of it (specs/07-rays.md). Everything
here is float64 from the packed record, so any node computes the same step for the same ray.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.math_kernels import f32_bits, f32_from_bits

_STEPS = 65535.0


@njit(error_model="numpy")
def _slab(origin, direction, low, high, t_in, t_out):  # type: ignore[no-untyped-def]
    if abs(direction) < 1e-30:
        if origin < low or origin > high:
            return 1.0, 0.0
        return t_in, t_out
    inverse = 1.0 / direction
    t_a, t_b = (low - origin) * inverse, (high - origin) * inverse
    return max(t_in, min(t_a, t_b)), min(t_out, max(t_a, t_b))


@njit(error_model="numpy")
def box_span(ox, oy, oz, dx, dy, dz, low, high):  # type: ignore[no-untyped-def]
    """(t_in, t_out) of the ray in the box, from t = 0 on; t_in > t_out if it misses."""
    t_in, t_out = _slab(ox, dx, low[0], high[0], 0.0, math.inf)
    t_in, t_out = _slab(oy, dy, low[1], high[1], t_in, t_out)
    return _slab(oz, dz, low[2], high[2], t_in, t_out)


@njit(error_model="numpy")
def t_of_step(step, t_in, t_out):  # type: ignore[no-untyped-def]
    """Where along the ray step k of its span lies."""
    return t_in + (t_out - t_in) * (step / _STEPS)


@njit(error_model="numpy")
def step_after(t, t_in, t_out, step):  # type: ignore[no-untyped-def]
    """The first step at or behind t, at least one past `step`, at most 65535: so a ray always gets on."""
    if not t < t_out:
        return 65535
    span = t_out - t_in
    if not span > 0.0:
        return 65535
    following = int(math.ceil((t - t_in) / span * _STEPS))
    return min(max(following, step + 1), 65535)


@njit(error_model="numpy")
def _offset_axis(p, n):  # type: ignore[no-untyped-def]
    """Move one f32 coordinate along its normal's sign by an amount that exceeds its rounding error.

    After Waechter and Binder, A Fast and Robust Method for Avoiding Self-Intersection (Ray Tracing Gems,
    2019): a step in units in the last place far from zero, a fixed one near it.
    """
    p32 = np.float32(p)
    if abs(p32) < np.float32(0.03125):
        return np.float32(p32 + np.float32(n) * np.float32(1.0 / 65536.0))
    ulps = np.int64(256.0 * n)
    if p32 < np.float32(0.0):
        ulps = -ulps
    return f32_from_bits(np.uint32(np.int64(f32_bits(p32)) + ulps))


@njit(error_model="numpy")
def offset_origin(px, py, pz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """The f32 origin of a ray that leaves the surface point on the side into which the unit normal points."""
    return _offset_axis(px, nx), _offset_axis(py, ny), _offset_axis(pz, nz)
