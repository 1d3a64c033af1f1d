"""A partition: one immutable value that says who answers for which part of space (rendering.md, One node).

It is issued by the owner of a job's location, numbered by `epoch`, sent as a plain document, and equal if and
only if all bytes are equal. `values` are the little-endian f64 numbers of its family (see there), so nothing
is lost or rounded on the way. Kernels compute with `kernel_data()`; for arrays there are three methods here.
numba is imported by their first call, not by this module.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition import boxes, power, slabs, voronoi, wedges
from scenefold.partition.families import RULES, Family
from scenefold.partition.frame import Frame

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

COORDINATE_MAX = 1e100
"""Squares and their sums stay finite."""
EPOCH_MAX = 2**63 - 1
_NO_DIRECTIONS = np.zeros((0, 3))


@dataclass(frozen=True, slots=True)
class Partition:
    """All cells of one epoch. Node indices are 0 .. nodes-1; which node of the cluster has which is the job's."""

    epoch: int
    family: Family
    nodes: int
    values: bytes

    def __post_init__(self) -> None:
        fault = _fault(self.epoch, self.family, self.nodes, self.values)
        if fault:
            raise LocalFault(f"no partition: {fault}")

    @classmethod
    def voronoi(cls, centroids: npt.ArrayLike, *, epoch: int = 1) -> Self:
        """Cells of what is nearest to each of the centroids, f64[N, 3]."""
        table = np.asarray(centroids, np.float64).reshape(-1, 3)
        return cls(epoch, Family.VORONOI, len(table), _canonical(voronoi.pack(table)))

    @classmethod
    def wedges(cls, frame: Frame, bounds: npt.ArrayLike, *, epoch: int = 1) -> Self:
        """Sectors around the frame's axis, between N - 1 ascending fractions of a turn (`fit_bounds` gives such)."""
        inner = np.asarray(bounds, np.float64).reshape(-1)
        return cls(epoch, Family.WEDGES, len(inner) + 1, _canonical(wedges.pack(frame, inner)))

    @classmethod
    def slabs(cls, frame: Frame, bounds: npt.ArrayLike, *, epoch: int = 1) -> Self:
        """Slices across the frame's axis, between N - 1 depths from its origin, none below the one before it."""
        inner = np.asarray(bounds, np.float64).reshape(-1)
        return cls(epoch, Family.SLABS, len(inner) + 1, _canonical(slabs.pack(frame, inner)))

    @classmethod
    def power(cls, centroids: npt.ArrayLike, weights: npt.ArrayLike, *, epoch: int = 1) -> Self:
        """Cells of the least squared distance less weight: centroids f64[N, 3], weights f64[N] in squares of the unit."""
        table, masses = np.asarray(centroids, np.float64).reshape(-1, 3), np.asarray(weights, np.float64).reshape(-1)
        if len(table) != len(masses):
            raise LocalFault(f"{len(table)} centroids do not go with {len(masses)} weights")
        return cls(epoch, Family.POWER, len(table), _canonical(power.pack(table, masses)))

    @classmethod
    def boxes(cls, cuts: list[boxes.Cut], *, epoch: int = 1) -> Self:
        """Leaves of a k-d tree of these N - 1 cuts, root first, then its lower side, then its upper side."""
        return cls(epoch, Family.BOXES, len(cuts) + 1, _canonical(boxes.pack(cuts)))

    def with_numbers(self, numbers: npt.ArrayLike) -> Self:
        """This partition with other numbers of its family, in the next epoch; itself if they are the same."""
        values = _canonical(np.asarray(numbers, np.float64).reshape(-1))
        return self if values == self.values else type(self)(self.epoch + 1, self.family, self.nodes, values)

    def with_epoch(self, epoch: int) -> Self:
        """The same cells in another epoch."""
        return type(self)(epoch, self.family, self.nodes, self.values)

    def to_document(self) -> dict[str, Any]:
        """As plain ints and bytes, to be packed by whoever sends it."""
        return {"epoch": self.epoch, "family": int(self.family), "nodes": self.nodes, "values": self.values}

    @classmethod
    def from_document(cls, document: object) -> Self:
        """The partition another node sent; PeerFault if it is none."""
        if not isinstance(document, dict) or set(document) != {"epoch", "family", "nodes", "values"}:
            raise PeerFault("a partition has epoch, family, nodes and values, and nothing else")
        fault = _fault(document["epoch"], document["family"], document["nodes"], document["values"])
        if fault:
            raise PeerFault(f"no partition: {fault}")
        return cls(document["epoch"], Family(document["family"]), document["nodes"], document["values"])

    @property
    def numbers(self) -> Floats:
        """The family's numbers, read-only."""
        return np.frombuffer(self.values, "<f8").astype(np.float64, copy=False)

    def kernel_data(self) -> Floats:
        """The table that kernels take as `data`: a fresh, contiguous f64 array, at each call."""
        return RULES[self.family].kernel_data(self.numbers, self.nodes)

    def owner(self, points: npt.ArrayLike, directions: npt.ArrayLike | None = None) -> Indices:
        """Node of each point f64[n, 3]: int32[n]. On a hull the lowest; or, with directions, whose cell it enters."""
        from scenefold.partition import kernels

        places = _rows(points)
        ways = _NO_DIRECTIONS if directions is None else _rows(directions)
        if directions is not None and ways.shape != places.shape:
            raise LocalFault(f"{len(places)} points do not go with {len(ways)} directions")
        found = np.empty(len(places), np.int32)
        kernels.owners(int(self.family), self.kernel_data(), places, ways, found)
        return found

    def exit(self, origins: npt.ArrayLike, directions: npt.ArrayLike, t: npt.ArrayLike, nodes: npt.ArrayLike) -> tuple[Floats, Indices]:
        """Where, from t on, each ray leaves its node's cell, and into whose: f64[n] (inf: never), int32[n] (then -1).

        A ray that at t is outside its node's cell, and will not enter it, leaves at t.
        """
        from scenefold.partition import kernels

        starts, ways = _rows(origins), _rows(directions)
        start = np.ascontiguousarray(np.broadcast_to(np.asarray(t, np.float64), len(starts)))
        mine = np.ascontiguousarray(np.broadcast_to(np.asarray(nodes, np.int32), len(starts)))
        if ways.shape != starts.shape:
            raise LocalFault(f"{len(starts)} origins do not go with {len(ways)} directions")
        if len(mine) and not 0 <= mine.min() <= mine.max() < self.nodes:
            raise LocalFault(f"a node index lies outside 0 to {self.nodes - 1}")
        t_exit, target = np.empty(len(starts)), np.empty(len(starts), np.int32)
        kernels.exits(int(self.family), self.kernel_data(), starts, ways, start, mine, t_exit, target)
        return t_exit, target

    def overlaps(self, low: npt.ArrayLike, high: npt.ArrayLike, dilation: float) -> npt.NDArray[np.bool_]:
        """Which nodes must hold what lies in which box: bool[N, m]. False only where box and grown cell are apart.

        `low` and `high` are f64[m, 3] with low <= high, the cells are grown by `dilation` >= 0 on all sides.
        """
        from scenefold.partition import kernels

        lows, highs = _rows(low), _rows(high)
        if lows.shape != highs.shape or not (lows <= highs).all() or not 0.0 <= dilation < np.inf:
            raise LocalFault("boxes need a low corner below the high one, and a dilation of 0 or more")
        mask = np.empty((self.nodes, len(lows)), np.bool_)
        kernels.overlaps(int(self.family), self.kernel_data(), lows, highs, float(dilation), mask)
        return mask


def _fault(epoch: object, family: object, nodes: object, values: object) -> str:
    """What keeps these from being a partition, or ""."""
    if type(epoch) is not int or not 0 <= epoch <= EPOCH_MAX:
        return "the epoch is no number from 0 to 2^63 - 1"
    if not isinstance(family, int) or isinstance(family, bool) or family not in set(Family):
        return "the family of cells is unknown"
    if type(nodes) is not int or not 1 <= nodes <= POOL_NODES_MAX:
        return f"cells are for 1 to {POOL_NODES_MAX} nodes"
    rules = RULES[Family(family)]
    if not isinstance(values, bytes) or len(values) != 8 * rules.size(nodes):
        return f"{nodes} nodes need {rules.size(nodes)} numbers of 8 bytes"
    numbers = np.frombuffer(values, "<f8").astype(np.float64, copy=False)
    if not (np.abs(numbers) <= COORDINATE_MAX).all():
        return "a number is not finite, or too large"
    if (np.signbit(numbers) & (numbers == 0.0)).any():
        return "zero has no sign here, so that equal cells have equal bytes"
    return rules.fault(numbers, nodes)


def _canonical(numbers: Floats) -> bytes:
    return (numbers + 0.0).astype("<f8").tobytes()  # + 0.0 turns -0.0 into 0.0


def _rows(array: npt.ArrayLike) -> Floats:
    """As contiguous f64[n, 3]."""
    rows = np.ascontiguousarray(array, np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise LocalFault(f"points and directions come as rows of three numbers, not as an array of shape {rows.shape}")
    return rows
