"""Boxes of a scene: the world with all instances, and the cube that the geometry space's lattice divides."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Box = tuple[NDArray[np.float64], NDArray[np.float64]]


def world_box(instances: NDArray[np.void], boxes: dict[int, Box]) -> Box:
    """The box of all instances (INSTANCE_ROW) of prototypes with these boxes, slightly enlarged."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for prototype, (near, far) in boxes.items():
        matrices = instances["matrix"][instances["prototype"] == prototype].astype(np.float64)
        for corner in itertools.product(*zip(near, far, strict=True)):
            moved = (matrices[:, :, :3] * np.array(corner)).sum(axis=2) + matrices[:, :, 3]
            low, high = np.minimum(low, moved.min(axis=0)), np.maximum(high, moved.max(axis=0))
    # Rounding when a ray is carried into an instance must not leave the box; nor may it be flat.
    margin = max(1e-4 * float((high - low).max()), 1e-6 * float(np.maximum(np.abs(low), np.abs(high)).max()), 1e-9)
    return low - margin, high + margin


def cube(low: NDArray[np.float64], high: NDArray[np.float64]) -> Box:
    """The cube around a box: equal cells in all directions."""
    middle, half = (low + high) / 2, float((high - low).max()) / 2
    return middle - half, middle + half
