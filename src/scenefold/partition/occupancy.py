"""Where a scene's box is empty: two grids of 128^3 bits (specs/28-rebalancing.md, Empty space).

A ray may skip a cell in which its interval meets no occupied voxel. What is marked lies in both grids, the second of which
is half a voxel aside, so that a ray that grazes a voxel of one may still be told apart by the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.placement import checked_box
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
Grids = npt.NDArray[np.uint64]

SHIFT = (0.25, 0.75)
"""Voxels, by which each grid begins below the box."""
_SPAN = 127.0
"""Voxels that the box takes on each axis: the rest is for the shift."""


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Which voxels hold geometry. `grids` is uint64[2, 128, 128, 2], a bit for each z, the lowest bit first."""

    low: Floats
    high: Floats
    per_voxel: Floats
    """f64[3]: voxels a unit."""
    grids: Grids

    def is_occupied(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, t_from: npt.ArrayLike, t_to: npt.ArrayLike
    ) -> npt.NDArray[np.bool_]:
        """Per ray o + t d whether it may meet geometry for t_from <= t <= t_to: bool[n]. False is certain."""
        from scenefold.partition import occupancy_walk_kernels as kernels

        starts, ways = _rays(origins, directions)
        begin, end = (np.ascontiguousarray(np.broadcast_to(np.asarray(t, np.float64), len(starts))) for t in (t_from, t_to))
        found = np.empty(len(starts), np.bool_)
        kernels.occupied(self.grids, self.low, self.high, self.per_voxel, np.array(SHIFT), starts, ways, begin, end, found)
        return found

    def next_cells(
        self, partition: Partition, origins: npt.ArrayLike, directions: npt.ArrayLike, t: npt.ArrayLike, nodes: npt.ArrayLike
    ) -> tuple[Floats, Indices]:
        """From t on in the cells of `nodes`, the first cell in which each ray may meet geometry: where it enters, f64[n], and whose, int32[n].

        The present cell counts, too: then t comes back. (inf, -1) if there is none: the ray meets nothing any more.
        """
        from scenefold.partition import occupancy_walk_kernels as kernels

        starts, ways = _rays(origins, directions)
        begin = np.ascontiguousarray(np.broadcast_to(np.asarray(t, np.float64), len(starts)))
        mine = np.ascontiguousarray(np.broadcast_to(np.asarray(nodes, np.int32), len(starts)))
        if len(mine) and not 0 <= mine.min() <= mine.max() < partition.nodes:
            raise LocalFault(f"a node index lies outside 0 to {partition.nodes - 1}")
        t_found, found = np.empty(len(starts)), np.empty(len(starts), np.int32)
        cells = int(partition.family), partition.kernel_data(), partition.nodes
        grid = self.grids, self.low, self.high, self.per_voxel, np.array(SHIFT)
        kernels.next_cells(*cells, *grid, starts, ways, begin, mine, t_found, found)
        return t_found, found


def occupancy(box: npt.ArrayLike, low: npt.ArrayLike, high: npt.ArrayLike, dilation: float = 0.0) -> Occupancy:
    """The bitmap of a scene's box f64[2, 3] from boxes f64[m, 3] twice of its triangles, grown by `dilation` >= 0.

    LocalFault for boxes inside out, or outside of the scene's.
    """
    from scenefold.partition import occupancy_kernels

    corners = checked_box(box)
    lows, highs = np.ascontiguousarray(low, np.float64).reshape(-1, 3), np.ascontiguousarray(high, np.float64).reshape(-1, 3)
    if lows.shape != highs.shape or not (lows <= highs).all() or not 0.0 <= dilation < np.inf:
        raise LocalFault("boxes need a low corner below the high one, and a dilation of 0 or more")
    if len(lows) and not ((lows >= corners[0]).all() and (highs <= corners[1]).all()):
        raise LocalFault("geometry lies outside of the scene's box")
    begin, end = corners[0] - dilation, corners[1] + dilation
    # A flat box gets some thickness, and any box enough for the digits of its place.
    sides = np.maximum(end - begin, 1e-9 * np.maximum(np.abs(begin), np.abs(end)).max())
    sides = np.where(sides > 0.0, sides, 1.0)
    per_voxel = _SPAN / sides
    grids = np.zeros((2, 128, 128, 2), np.uint64)
    occupancy_kernels.mark(grids, begin, per_voxel, np.array(SHIFT), lows, highs, float(dilation))
    return Occupancy(begin, begin + sides, per_voxel, grids)


def _rays(origins: npt.ArrayLike, directions: npt.ArrayLike) -> tuple[Floats, Floats]:
    starts, ways = np.ascontiguousarray(origins, np.float64), np.ascontiguousarray(directions, np.float64)
    if starts.ndim != 2 or starts.shape[1] != 3 or starts.shape != ways.shape:
        raise LocalFault("rays have origins and directions, rows of three numbers each")
    return starts, ways
