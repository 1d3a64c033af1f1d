"""Where a scene's box is empty: two grids of 128^3 bits (specs/28-rebalancing.md, Empty space).

A ray may skip a cell in which its interval meets no occupied voxel. What is marked lies in both grids, the second of which
is half a voxel aside, so that a ray that grazes a voxel of one may still be told apart by the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.leaps import SHIFT, Leaps
from scenefold.partition.placement import checked_box

Floats = npt.NDArray[np.float64]
Grids = npt.NDArray[np.uint64]

_SPAN = 127.0
"""Voxels that the box takes on each axis: the rest is for the shift."""


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Which voxels hold geometry. `grids` is uint64[2, 128, 128, 2], a bit for each z, the lowest bit first."""

    low: Floats
    high: Floats
    per_voxel: Floats
    """f64[3]: voxels a unit."""
    dilation: float
    """By so much all that marks is grown."""
    grids: Grids

    def mark(self, low: npt.ArrayLike, high: npt.ArrayLike) -> None:
        """Boxes f64[m, 3] twice, within the box that it was made for; LocalFault if not, or inside out."""
        from scenefold.partition import occupancy_kernels

        lows, highs = np.ascontiguousarray(low, np.float64).reshape(-1, 3), np.ascontiguousarray(high, np.float64).reshape(-1, 3)
        if lows.shape != highs.shape or not (lows <= highs).all():
            raise LocalFault("boxes need a low corner below the high one")
        if len(lows) and not ((lows >= self.low + self.dilation).all() and (highs <= self.high - self.dilation).all()):
            raise LocalFault("geometry lies outside of the scene's box")
        occupancy_kernels.mark(self.grids, self.low, self.per_voxel, np.array(SHIFT), lows, highs, self.dilation)

    def leaps(self) -> Leaps:
        """What rays need to go past what is empty. It takes a few tenths of a second."""
        from scenefold.partition import leap_kernels

        return Leaps(leap_kernels.distances(self.grids), self.low, self.high, self.per_voxel, np.array(SHIFT))


def first_near(leaps: Leaps, origins: npt.ArrayLike, directions: npt.ArrayLike, t_from: npt.ArrayLike, t_to: npt.ArrayLike) -> Floats:
    """Per ray o + t d the first t, t_from <= t <= t_to, from which on it may meet geometry: f64[n]; inf: it certainly meets nothing."""
    from scenefold.partition import leap_kernels

    starts, ways = np.ascontiguousarray(origins, np.float64), np.ascontiguousarray(directions, np.float64)
    if starts.ndim != 2 or starts.shape[1] != 3 or starts.shape != ways.shape:
        raise LocalFault("rays have origins and directions, rows of three numbers each")
    begin, end = (np.ascontiguousarray(np.broadcast_to(np.asarray(t, np.float64), len(starts))) for t in (t_from, t_to))
    found = np.empty(len(starts))
    leap_kernels.first_near_each(*leaps, starts, ways, begin, end, found)
    return found


def nothing_in(box: npt.ArrayLike, dilation: float = 0.0) -> Occupancy:
    """The bitmap of a scene's box f64[2, 3], before anything is marked; all that will be is grown by `dilation` >= 0. LocalFault."""
    corners = checked_box(box)
    if not 0.0 <= dilation < np.inf:
        raise LocalFault("what marks is grown by a dilation of 0 or more")
    begin, end = corners[0] - dilation, corners[1] + dilation
    # A flat box gets some thickness, and any box enough for the digits of its place.
    sides = np.maximum(end - begin, 1e-9 * np.maximum(np.abs(begin), np.abs(end)).max())
    sides = np.where(sides > 0.0, sides, 1.0)
    return Occupancy(begin, begin + sides, _SPAN / sides, float(dilation), np.zeros((2, 128, 128, 2), np.uint64))


def occupancy(box: npt.ArrayLike, low: npt.ArrayLike, high: npt.ArrayLike, dilation: float = 0.0) -> Occupancy:
    """The bitmap of a scene's box f64[2, 3] from boxes f64[m, 3] twice, grown by `dilation` >= 0. LocalFault."""
    made = nothing_in(box, dilation)
    made.mark(low, high)
    return made
