"""Wedges as numbers: N + 8 of them (thesis 3.3.7, Bounded radial; specs/06-cells.md).

    0-2    a point of the axis
    3-5    unit vector towards bound 0, across the axis
    6-8    unit vector a quarter turn on, in the direction of counting, across both
    9-     bounds 1 .. N-1 as fractions of a turn, ascending; bounds 0 and N are 0 and 1, the same half-plane

Every node gets the same bits out of them: cosines and sines of the bounds are our own polynomials.
A wedge wider than half a turn is not convex, so spans are limited; two wedges are two half spaces and cannot
be anything else. Radial's moving bound 0 is a turned frame, and needs no other numbers.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.partition.frame import Frame
from scenefold.partition.turns import cosine_and_sine

Floats = npt.NDArray[np.float64]

SPAN_MIN = 2.0**-20
"""Turns. A thinner wedge is narrower than a ray's steps at any distance, and no work can be measured in it."""
SPAN_MAX = 0.5 - 2.0**-20
"""Turns, for three nodes and more. A little less than half, so that rounding cannot make a cell concave."""
_SLACK = 2.0**-40
"""A bound is a sum of spans, and may miss the limits by its rounding."""
_SQUARE = 1e-9
"""How far from unit length and right angles a frame may be: rounding, and no more."""


def size(nodes: int) -> int:
    return nodes + 8


def fault(values: Floats, nodes: int) -> str:
    axes = values[3:9].reshape(2, 3)
    if np.abs(axes @ axes.T - np.eye(2)).max() > _SQUARE:
        return "the frame of the wedges is not orthonormal"
    if nodes == 1:
        return ""
    spans = np.diff(all_bounds(values))
    if nodes == 2:
        return "" if spans[0] == 0.5 else "two wedges must be half a turn each"
    if spans.min() < SPAN_MIN - _SLACK:
        return "bounds of wedges must ascend"
    if spans.max() > SPAN_MAX + _SLACK:
        return "a wedge is wider than half a turn, so it is not convex"
    return ""


def all_bounds(values: Floats) -> Floats:
    """The N + 1 bounds with 0 and 1."""
    return np.concatenate([[0.0], values[9:], [1.0]])


def kernel_data(values: Floats, nodes: int) -> Floats:
    """f64[N + 3, 3] as `wedge_kernels` reads it: a fresh array."""
    data = np.zeros((nodes + 3, 3))
    data[:3] = values[:9].reshape(3, 3)
    data[3:, :2] = [cosine_and_sine(float(bound)) for bound in all_bounds(values)[:-1]]
    return data


def pack(frame: Frame, bounds: npt.ArrayLike) -> Floats:
    """The canonical numbers of wedges around the frame's axis, with these N - 1 inner bounds."""
    inner = np.asarray(bounds, np.float64).reshape(-1)
    return np.concatenate([frame.origin, frame.zero, frame.quarter, inner]).astype(np.float64)
