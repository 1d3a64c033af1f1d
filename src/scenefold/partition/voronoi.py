"""Voronoi cells as numbers: 3 N of them, the centroids x, y, z in order of nodes (specs/06-cells.md)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def size(nodes: int) -> int:
    return 3 * nodes


def fault(values: Floats, nodes: int) -> str:  # noqa: ARG001
    """Any finite centroids will do, equal ones too: the lowest node then owns all, and the others nothing."""
    return ""


def kernel_data(values: Floats, nodes: int) -> Floats:
    """f64[N, 3] as `voronoi_kernels` reads it: a fresh array."""
    return values.reshape(nodes, 3).copy()


def pack(centroids: npt.ArrayLike) -> Floats:
    """The canonical numbers of these centroids, f64[N, 3]."""
    return np.ascontiguousarray(centroids, np.float64).reshape(-1)
