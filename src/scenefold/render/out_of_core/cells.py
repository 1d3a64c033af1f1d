"""Into how many cells a scene is cut, so that each one's trees can be built within the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition import Partition
from scenefold.partition.boxes import Cut
from scenefold.render.arrays import F64, I64, SceneArrays
from scenefold.render.content import Share, cell_margin, pair_boxes, shares_of
from scenefold.render.contract import HeldGroup, HeldScene
from scenefold.scene.tables import SceneTables

BYTES_PER_TRIANGLE = 108
"""While a tree is built: 32 of the builder's own, some 70 of the tree, and a little. Measured on terrains of 10^5 and 10^6 triangles."""
BUILT_SHARE = 0.67
"""What is left of that when it is built."""
BYTES_PER_GROUP = 2048
BYTES_PER_INSTANCE = 400
"""Of Embree's: some 320, measured with 250,000."""
BYTES_PER_PROTOTYPE = 16_384
"""A scene of its own."""
_EVENNESS = 1.0
"""What a triangle of the larger half counts for, beside one that any half holds."""
_LESS = 1.0 - 1e-9
"""Of what a box holds: the most that a half of it may hold."""


@dataclass(frozen=True, slots=True)
class Cells:
    """A partition, and what each cell holds of the scene."""

    partition: Partition
    shares: tuple[Share, ...]
    peaks: tuple[int, ...]
    """Bytes that the trees of each cell take while they are built, as estimated."""

    centres: F64
    """f64[cells, 3], means of what the cells hold."""

    def from_near_to_far(self, eye: F64) -> list[int]:
        """All cells, by how far from there is what they hold."""
        return [int(cell) for cell in np.argsort(((self.centres - eye) ** 2).sum(axis=1), kind="stable")]

    @property
    def largest(self) -> int:
        """The largest of these."""
        return max(self.peaks)


def cells_within(tables: SceneTables, peak: int) -> Cells:
    """Boxes whose trees take at most `peak` bytes each while they are built; as many as there may be, if more were needed: the largest is too large then."""
    pairs = _Pairs(tables)
    whole = _Box(pairs, np.arange(len(pairs.groups)), np.full(3, -np.inf), np.full(3, np.inf))
    fixed: set[int] = set()
    leaves = [whole]
    while len(leaves) < POOL_NODES_MAX:
        heaviest = max((leaf for leaf in leaves if id(leaf) not in fixed), key=lambda leaf: leaf.peak, default=None)
        if heaviest is None or heaviest.peak <= peak:
            break
        if heaviest.cut_in_two():
            leaves.remove(heaviest)
            leaves += heaviest.halves
        else:
            fixed.add(id(heaviest))
    partition = Partition.boxes(whole.cuts()) if whole.halves else Partition.voronoi(((pairs.low + pairs.high) * 0.5).mean(axis=0)[None])
    shares = tuple(shares_of(tables, partition, range(partition.nodes)))
    centres = np.array([(leaf.centre) for leaf in whole.leaves()])
    return Cells(partition, shares, tuple(peak_bytes(tables, share) for share in shares), centres)


class _Pairs:
    """(instance, group) pairs of a scene, and their world boxes, grown by what a cell is grown by."""

    def __init__(self, tables: SceneTables) -> None:
        self.tables = tables
        self.instances, self.groups, low, high = pair_boxes(tables)
        margin = cell_margin(tables)
        self.low, self.high = low - margin, high + margin
        self.triangles = tables.groups.triangles[self.groups].astype(np.float64)


class _Box:
    """A part of space that is a cell, or cut into two."""

    def __init__(self, pairs: _Pairs, met: I64, low: F64, high: F64) -> None:
        """`met`: int64[n], the pairs whose boxes meet it; `low`, `high` f64[3], its corners."""
        self._pairs, self._met, self._low, self._high = pairs, met, low, high
        groups = tuple(np.unique(pairs.groups[met]).tolist())
        self.peak = peak_bytes(pairs.tables, Share(groups, tuple(np.unique(pairs.instances[met]).tolist()), 0, 0))
        self.halves: tuple[_Box, ...] = ()
        self._cut = Cut(0, 0.0, 1)

    def cut_in_two(self) -> bool:
        """Where both sides together hold least, and neither much more than the other; False where no plane leaves anything out of a side."""
        pairs, groups = self._pairs, self._pairs.groups[self._met]
        # A group that is there in several instances is held once.
        weights = pairs.triangles[self._met] / np.bincount(groups)[groups]
        best = np.inf
        for axis in range(3):
            low, high = pairs.low[self._met, axis], pairs.high[self._met, axis]
            planes = np.unique(np.concatenate([low, high]))
            planes = (planes[1:] + planes[:-1]) * 0.5
            planes = planes[(planes > self._low[axis]) & (planes < self._high[axis])]
            if not len(planes):
                continue
            lower, upper = _below(low, weights, planes), _below(-high, weights, -planes)
            larger = np.maximum(lower, upper)
            cost = np.where(larger < weights.sum() * _LESS, lower + upper + _EVENNESS * larger, np.inf)
            cheapest = int(np.argmin(cost))
            if cost[cheapest] < best:
                best, self._cut = float(cost[cheapest]), Cut(axis, float(planes[cheapest]), 1)
        if best == np.inf:
            return False
        axis, plane, _ = self._cut
        low, high = self._low.copy(), self._high.copy()
        high[axis] = low[axis] = plane
        self.halves = (
            _Box(pairs, self._met[pairs.low[self._met, axis] <= plane], self._low, high),
            _Box(pairs, self._met[pairs.high[self._met, axis] >= plane], low, self._high),
        )
        return True

    @property
    def centre(self) -> F64:
        """f64[3]: of what it holds."""
        met = self._met
        if not len(met):
            return np.zeros(3)
        mean: F64 = np.clip((self._pairs.low[met] + self._pairs.high[met]).mean(axis=0) * 0.5, self._low, self._high)
        return mean

    def leaves(self) -> list[_Box]:
        """The cells that it was cut into, in their order."""
        return [leaf for half in self.halves for leaf in half.leaves()] or [self]

    def cuts(self) -> list[Cut]:
        """Of it and all that it was cut into, root first, lower side before upper."""
        if not self.halves:
            return []
        lower, upper = (half.cuts() for half in self.halves)
        return [Cut(self._cut.axis, self._cut.plane, len(lower) + 1), *lower, *upper]


def _below(edges: F64, weights: F64, planes: F64) -> F64:
    """f64[m]: what begins at most at each of the planes."""
    order = np.argsort(edges)
    running: F64 = np.concatenate([[0.0], np.cumsum(weights[order])])
    found: F64 = running[np.searchsorted(edges[order], planes, side="right")]
    return found


def peak_bytes(tables: SceneTables, share: Share) -> int:
    """What the trees over a share take while they are built, as estimated."""
    groups = np.array(share.groups, np.int64)
    prototypes = np.unique(tables.groups.prototypes[groups])
    triangles = int(tables.groups.triangles[groups].sum(dtype=np.int64))
    return (
        BYTES_PER_TRIANGLE * triangles
        + BYTES_PER_GROUP * len(groups)
        + BYTES_PER_PROTOTYPE * len(prototypes)
        + BYTES_PER_INSTANCE * len(share.instances)
    )


def held_of(tables: SceneTables, arrays: SceneArrays, share: Share) -> HeldScene:
    """A share as a renderer takes it, over the arrays of the whole scene."""
    return HeldScene(
        arrays,
        tuple(HeldGroup(group, int(tables.groups.prototypes[group]), int(tables.groups.triangles[group])) for group in share.groups),
        tuple((instance, int(tables.instances.prototypes[instance])) for instance in share.instances),
    )
