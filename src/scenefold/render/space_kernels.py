"""Rays in the job's box: spans, steps of t_done, and origins that do not hit their own surface.

A ray's span is where it crosses the job's box; t_done counts 65,535 steps of it (specs/07-rays.md). Spans and steps
are float64 from the packed record, so any node computes the same step for the same ray; origins are made in lanes.
"""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.lane_values_kernels import select

_STEPS = 65535.0
_OFFSET_OF_REACH = 2.0**-18
_OFFSET_OF_COORDINATE = 2.0**-20


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _slab(origin, direction, low, high, t_in, t_out):  # type: ignore[no-untyped-def]
    parallel, outside = abs(direction) < 1e-30, (origin < low) | (origin > high)
    inverse = 1.0 / direction
    t_a, t_b = (low - origin) * inverse, (high - origin) * inverse
    return (
        select(parallel, select(outside, 1.0, t_in), max(t_in, min(t_a, t_b))),
        select(parallel, select(outside, 0.0, t_out), min(t_out, max(t_a, t_b))),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def box_span(ox, oy, oz, dx, dy, dz, low, high):  # type: ignore[no-untyped-def]
    """(t_in, t_out) of the ray in the box, from t = 0 on; t_in > t_out if it misses."""
    t_in, t_out = _slab(ox, dx, low[0], high[0], 0.0, math.inf)
    t_in, t_out = _slab(oy, dy, low[1], high[1], t_in, t_out)
    return _slab(oz, dz, low[2], high[2], t_in, t_out)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def t_of_step(step, t_in, t_out):  # type: ignore[no-untyped-def]
    """Where along the ray step k of its span lies."""
    return t_in + (t_out - t_in) * (step / _STEPS)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def step_after(t, t_in, t_out, step):  # type: ignore[no-untyped-def]
    """The first step at or behind t, at least one past `step`, at most 65535: so a ray always gets on."""
    if not t < t_out:
        return 65535
    span = t_out - t_in
    if not span > 0.0:
        return 65535
    following = int(math.ceil((t - t_in) / span * _STEPS))
    return min(max(following, step + 1), 65535)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def step_before(t, t_in, t_out, step):  # type: ignore[no-untyped-def]
    """The last step at or before t, at least `step`, at most 65534: what is done up to t is done up to there."""
    span = t_out - t_in
    if not span > 0.0:
        return step
    return min(max(int(math.floor((t - t_in) / span * _STEPS)), step), 65534)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def diagonal_of_box(low, high):  # type: ignore[no-untyped-def]
    """The length of a box's diagonal."""
    x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    return math.sqrt(x * x + y * y + z * z)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def longest_side(e1x, e1y, e1z, e2x, e2y, e2z):  # type: ignore[no-untyped-def]
    """The longest of two edges of a triangle, along an axis."""
    return max(max(max(abs(e1x), abs(e1y)), max(abs(e1z), abs(e2x))), max(abs(e2y), abs(e2z)))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def offset_origin(px, py, pz, nx, ny, nz, reach):  # type: ignore[no-untyped-def]
    """The origin of a ray that leaves the surface point on the side into which the unit normal points.

    It must lie so far off that rounding cannot bring it back: of the caster's differences between a ray and a triangle's corners, which
    grow with the triangle (`reach`), and of the point itself, in the world and in an instance's space, which grow with its
    coordinates. What else is in the scene, or how large that is, is no matter: a lamp far away would move every shadow. A fixed step, as
    Waechter and Binder have it (Ray Tracing Gems, 2019, chapter 6), is a wall's thickness in a scene of millimetres, and nothing in one of kilometres.
    """
    step = reach * _OFFSET_OF_REACH + max(abs(px), max(abs(py), abs(pz))) * _OFFSET_OF_COORDINATE
    return px + nx * step, py + ny * step, pz + nz * step
