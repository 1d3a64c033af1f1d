"""Into how many cells a scene is cut, so that each one's trees can be built within the budget."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition import Partition
from scenefold.render.arrays import F64, SceneArrays
from scenefold.render.content import Share, pair_boxes, shares_of
from scenefold.render.contract import HeldGroup, HeldScene
from scenefold.scene.tables import SceneTables

BYTES_PER_TRIANGLE = 108
"""While a tree is built: 32 of the builder's own, some 70 of the tree, and a little. Measured on terrains of 10^5 and 10^6 triangles."""
BUILT_SHARE = 0.67
"""What is left of that when it is built."""
BYTES_PER_GROUP = 2048
BYTES_PER_INSTANCE = 1024
BYTES_PER_PROTOTYPE = 16_384
"""A scene of its own."""


@dataclass(frozen=True, slots=True)
class Cells:
    """A partition, and what each cell holds of the scene."""

    partition: Partition
    shares: tuple[Share, ...]
    peaks: tuple[int, ...]
    """Bytes that the trees of each cell take while they are built, as estimated."""

    @property
    def largest(self) -> int:
        """The largest of these."""
        return max(self.peaks)


def cells_within(tables: SceneTables, peak: int) -> Cells:
    """The fewest cells, of 1, 2, 4, …, whose trees take at most `peak` bytes each while they are built; those whose largest is smallest if none do."""
    _, groups, low, high = pair_boxes(tables)
    centres, sizes = (low + high) * 0.5, tables.groups.triangles[groups].astype(np.float64)
    most = min(POOL_NODES_MAX, len(centres))
    best: Cells | None = None
    count = 1
    while True:
        cells = _cells(tables, Partition.voronoi(halved(centres, sizes, count)))
        if best is None or cells.largest < best.largest:
            best = cells
        if cells.largest <= peak or count == most:
            return best
        count = min(2 * count, most)


def _cells(tables: SceneTables, partition: Partition) -> Cells:
    shares = tuple(shares_of(tables, partition, range(partition.nodes)))
    return Cells(partition, shares, tuple(peak_bytes(tables, share) for share in shares))


def halved(points: F64, weights: F64, count: int) -> F64:
    """Centroids f64[count, 3] of cells that are about as heavy as each other, and compact: means of what is left when the points f64[n, 3], at least `count`, are cut
    across the longest side, again and again."""
    if count == 1:
        mean: F64 = points.mean(axis=0)[None]
        return mean
    side = int(np.argmax(points.max(axis=0) - points.min(axis=0)))
    order = np.argsort(points[:, side], kind="stable")
    fewer = count // 2
    running = np.cumsum(weights[order])
    cut = int(np.searchsorted(running * count, running[-1] * fewer)) + 1
    cut = min(max(cut, fewer), len(order) - (count - fewer))
    lower, upper = order[:cut], order[cut:]
    return np.concatenate([halved(points[lower], weights[lower], fewer), halved(points[upper], weights[upper], count - fewer)])


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
