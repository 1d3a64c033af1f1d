"""Slabs as numbers: N + 5 of them (thesis 3.3.7, Planar; specs/06-cells.md).

    0-2    a point that depths are counted from
    3-5    unit vector along which they grow
    6-     bounds 1 .. N-1 as depths, none below the one before it

Node b's cell lies between bounds b and b + 1; the first and the last are half-spaces. Between equal bounds lies
nothing, so that any histogram has a fit.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.partition.frame import Frame

Floats = npt.NDArray[np.float64]

_SQUARE = 1e-9
"""How far from unit length the vector may be: rounding, and no more."""


def size(nodes: int) -> int:
    return nodes + 5


def fault(values: Floats, nodes: int) -> str:  # noqa: ARG001
    axis, inner = values[3:6], values[6:]
    if abs(float(axis @ axis) - 1.0) > _SQUARE:
        return "the axis of slabs is no unit vector"
    if (np.diff(inner) < 0.0).any():
        return "bounds of slabs must not descend"
    return ""


def kernel_data(values: Floats, nodes: int) -> Floats:
    """f64[N + 2, 3] as `slab_kernels` reads it: a fresh array."""
    data = np.zeros((nodes + 2, 3))
    data[:2] = values[:6].reshape(2, 3)
    data[3:, 0] = values[6:]
    return data


def pack(frame: Frame, bounds: npt.ArrayLike) -> Floats:
    """The canonical numbers of slabs across the frame's axis, with these N - 1 inner bounds."""
    inner = np.asarray(bounds, np.float64).reshape(-1)
    return np.concatenate([frame.origin, frame.axis, inner]).astype(np.float64)
