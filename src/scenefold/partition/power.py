"""Power cells as numbers: 4 N of them, x, y, z and weight of each node in order (partitions.md; specs/06-cells.md)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def size(nodes: int) -> int:
    return 4 * nodes


def fault(values: Floats, nodes: int) -> str:  # noqa: ARG001
    """Any finite numbers will do: a node that no point is nearest to has an empty cell."""
    return ""


def kernel_data(values: Floats, nodes: int) -> Floats:
    """f64[N, 4] as `power_kernels` reads it: a fresh array."""
    return values.reshape(nodes, 4).copy()


def pack(centroids: npt.ArrayLike, weights: npt.ArrayLike) -> Floats:
    """The canonical numbers of centroids f64[N, 3] with weights f64[N], in squares of the world's unit."""
    table = np.asarray(centroids, np.float64).reshape(-1, 3)
    return np.column_stack([table, np.asarray(weights, np.float64).reshape(-1)]).reshape(-1)
