"""How space is divided among the nodes of a job: in how many render pools, and with which cells (specs/36-render-pools.md, *Forming*).

Found by who organises the job, with the scene's tables, by where geometry lies; nobody else needs to come to the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scenefold.base.ids import NodeId
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.algorithms import WHOLE
from scenefold.render.content import shares_of
from scenefold.render.first_cells import first_cells
from scenefold.render.job import POOLS_THAT_FIT, RenderOptions
from scenefold.render.pool.forming import are_enough, even, formed
from scenefold.render.pool.image_memory import image_needs
from scenefold.render.pool.share import LANE, bytes_of
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.tables import SceneTables
from scenefold.world import Workers

EVERYTHING = Partition.voronoi([[0.0, 0.0, 0.0]])
"""The one cell of a node that is a pool of its own."""
CELLS_HELD = 2
"""While cells move, or a pool carves up one."""


def asks_budgets(options: RenderOptions) -> bool:
    """Whether it counts how much memory nodes have: in one pool, or with one for each node, nothing depends on that."""
    return options.pools != 1 and options.algorithm != WHOLE


class Dividing:
    """Of one job."""

    def __init__(
        self, workers: Workers, tables: SceneTables, options: RenderOptions, camera: Camera, free: Mapping[NodeId, int], nodes: int
    ) -> None:
        """`free`: bytes that the budgets of nodes left, if that counts. `nodes`: of the job."""
        self._workers, self._tables, self._options, self._camera, self._free = workers, tables, options, camera, free
        self._image = image_needs(options.window.pixels, options.layers, nodes, is_adaptive=options.adaptive is not None)
        self._first: dict[int, Partition] = {}
        """By the number of nodes."""

    async def fresh(self, nodes: Sequence[NodeId]) -> Division:
        """For these nodes of the job, in the order of the line, in a later attempt; epoch 1."""
        return await self._workers.run(LANE, self._divided, nodes)

    async def can_be(self, after: Division, before: Division, nodes: Sequence[NodeId]) -> bool:
        """Whether all of these have memory for their cells of `after`, beside those that they hold of `before`, as far as budgets were asked for."""
        return not self._free or await self._workers.run(LANE, self._can_be, after, before, nodes)

    def first(self, nodes: Sequence[NodeId]) -> Division:
        """For all nodes of the job, in the order of the line; epoch 1. In a worker.

        If they stand in more pools than hold the scene, since somebody asked for that, they say themselves what they lack: they know what
        they hold of textures.
        """
        asked = self._options.pools
        if self._options.algorithm == WHOLE or asked in (1, POOLS_THAT_FIT):
            return self._divided(nodes)
        return self._made(even(len(nodes), asked))

    def _divided(self, nodes: Sequence[NodeId]) -> Division:
        if self._options.algorithm == WHOLE:
            return self._made(even(len(nodes), len(nodes)))
        if self._options.pools == 1:
            return self._made([len(nodes)])
        free, asked = [self._free[node] for node in nodes], even(len(nodes), self._options.pools or len(nodes))
        return self._made(asked if are_enough(free, asked, self._needs) else formed(free, self._needs))

    def _made(self, sizes: Sequence[int]) -> Division:
        return Division(tuple(self._cells(size, sum(sizes)) for size in sizes))

    def _cells(self, size: int, nodes: int) -> Partition:
        if size == 1 < nodes:
            return EVERYTHING
        if size not in self._first:
            self._first[size] = first_cells(self._options.algorithm, size, self._tables, self._camera)
        return self._first[size]

    def _needs(self, size: int) -> int:
        most = max(self._bytes_of(self._cells(size, size + 1)))
        return self._image + (most if size == 1 else CELLS_HELD * most)

    def _can_be(self, after: Division, before: Division, nodes: Sequence[NodeId]) -> bool:
        known = {(one.family, one.values) for one in before.pools}
        for partition, places in zip(after.pools, after.ranges, strict=True):
            if (partition.family, partition.values) in known:
                continue
            for place, size in zip(places, self._bytes_of(partition), strict=True):
                if self._free[nodes[place]] < self._image + CELLS_HELD * size:
                    return False
        return True

    def _bytes_of(self, partition: Partition) -> list[int]:
        """What each of its nodes holds at most of the scene: which textures it wears is not known before it is read."""
        textures = range(len(self._tables.textures))
        shares = shares_of(self._tables, partition, range(partition.nodes))
        return [bytes_of(self._tables, share, textures)[0] for share in shares]
