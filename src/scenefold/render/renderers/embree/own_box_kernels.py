"""A test that makes a candidate's acceptance independent of the tree it was found in.

Embree's triangle test accepts a little more than the triangle, so that no ray slips between two of them; whether
such a candidate is reached at all depends on the boxes above it, hence on what else a node holds. So a candidate
counts only if the ray also meets the triangle's own box. Every box above holds that one, and Embree's test of boxes
is monotonous and has twice the tolerance of ours: who passes here is reached in every tree.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.renderers.embree.memory_kernels import load_f32, load_f64, load_i64, load_u32

MISSED = -1.0
_TOLERANCE = 1.0 + 2.0**-22
"""Embree takes three units of 2^-23 off the near end and adds three to the far one, and loses half of that to rounding."""
_PARALLEL = 2e-18
"""Embree replaces smaller components of a direction by 1e-18."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def own_box_entry(table, ray, group, primitive, inverses):  # type: ignore[no-untyped-def]
    """At which t >= 0 the ray enters the box of a triangle, MISSED if never. Addresses as in filter_kernels.py.

    inverses: address of 1 / direction, 3 x f64, where the ray is in the space in which it was cast; else 0.
    """
    triangle = load_i64(load_i64(table + 64) + 8 * int(group)) + int(primitive)
    corners, vertices = load_i64(table + 16) + 12 * triangle, load_i64(table)
    first = vertices + 12 * int(load_u32(corners))
    second = vertices + 12 * int(load_u32(corners + 4))
    third = vertices + 12 * int(load_u32(corners + 8))
    near, far = 0.0, math.inf
    for axis in range(3):
        at = 4 * axis
        a, b, c = load_f32(first + at), load_f32(second + at), load_f32(third + at)
        low, high = np.float64(min(a, min(b, c))), np.float64(max(a, max(b, c)))
        origin, direction = np.float64(load_f32(ray + at)), np.float64(load_f32(ray + 16 + at))
        if abs(direction) < _PARALLEL:
            # Embree multiplies by 1e18 then, so that an origin in the upper face is outside, in the lower one inside.
            if not low <= origin < high:
                return MISSED
        else:
            inverse = load_f64(inverses + 8 * axis) if inverses != 0 else 1.0 / direction
            t_low, t_high = (low - origin) * inverse, (high - origin) * inverse
            near, far = max(near, min(t_low, t_high)), min(far, max(t_low, t_high))
    return near if near <= far * _TOLERANCE else MISSED
