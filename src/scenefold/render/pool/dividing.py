"""How space is divided among the nodes of a job: in how many render pools, and with which cells (specs/36-render-pools.md, *Forming*).

Found by who organises the job, with the scene's tables, by where geometry lies; nobody else needs to come to the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

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


class Standing(NamedTuple):
    """How space is divided, and among whom, in the order of the line."""

    division: Division
    nodes: Sequence[NodeId]

    def pool_of(self, node: NodeId) -> Partition | None:
        """The cells of a node's pool; None if it has none."""
        return self.division.pools[self.division.pool_at(self.nodes.index(node))] if node in self.nodes else None


class Dividing:
    """Of one job."""

    def __init__(
        self, workers: Workers, tables: SceneTables, options: RenderOptions, camera: Camera, free: Mapping[NodeId, int], nodes: int
    ) -> None:
        """`free`: bytes that the budgets of nodes left, if that counts. `nodes`: of the job."""
        self._workers, self._tables, self._options, self._camera, self._free = workers, tables, options, camera, free
        self._image = image_needs(options.window.pixels, options.layers, nodes, is_adaptive=options.adaptive is not None)
        self._all, _, _ = bytes_of(tables, range(len(tables.groups)), range(len(tables.textures)))
        self._first: dict[int, Partition] = {}
        """By the number of nodes."""
        self._most: dict[int, int] = {1: self._all}
        """Bytes of the largest of these cells."""

    @property
    def goes_by_budgets(self) -> bool:
        """Whether there are as many pools as nodes have memory for, by what they said."""
        return bool(self._free) and self._options.pools == POOLS_THAT_FIT

    async def fresh(self, nodes: Sequence[NodeId], before: Standing) -> Division:
        """For these nodes of the job, in the order of the line, in a later attempt; epoch 1."""
        return await self._workers.run(LANE, self._divided, nodes, before)

    async def can_be(self, after: Standing, before: Standing) -> bool:
        """Whether all nodes have memory for their cells of `after`, beside those that they hold of `before`, as far as budgets were asked for."""
        return not self._free or await self._workers.run(LANE, self._can_be, after, before)

    def first(self, nodes: Sequence[NodeId]) -> Division:
        """For all nodes of the job, in the order of the line; epoch 1. In a worker.

        If they stand in more pools than hold the scene, since somebody asked for that, they say themselves what they lack: they know what
        they hold of textures.
        """
        asked = self._options.pools
        if self._options.algorithm == WHOLE or asked in (1, POOLS_THAT_FIT):
            return self._divided(nodes, None)
        return self._made(even(len(nodes), asked))

    def _divided(self, nodes: Sequence[NodeId], before: Standing | None) -> Division:
        """`before`: what nodes hold already; None: nothing."""
        if self._options.algorithm == WHOLE:
            return self._made(even(len(nodes), len(nodes)))
        if self._options.pools == 1:
            return self._made([len(nodes)])
        asked = even(len(nodes), self._options.pools or len(nodes))
        holds = partial(self._holds, nodes, before)
        return self._made(asked if are_enough(asked, holds) else formed(len(nodes), holds))

    def _made(self, sizes: Sequence[int]) -> Division:
        return Division.of([self._cells(size, sum(sizes)) for size in sizes], 1)

    def _cells(self, size: int, nodes: int) -> Partition:
        if size == 1 < nodes:
            return EVERYTHING
        if size not in self._first:
            self._first[size] = first_cells(self._options.algorithm, size, self._tables, self._camera)
        return self._first[size]

    def _holds(self, nodes: Sequence[NodeId], before: Standing | None, first: int, end: int) -> bool:
        """Whether these nodes, as a pool with its first cells, have memory for the scene."""
        size = end - first
        if not self._have(nodes[first:end], size, before, -(-self._all // size)):
            # The largest cell has that at least: so sizes that are much too small are not looked at.
            return False
        if size not in self._most:
            self._most[size] = max(self._bytes_of(self._cells(size, size + 1)))
        return self._have(nodes[first:end], size, before, self._most[size])

    def _have(self, nodes: Sequence[NodeId], size: int, before: Standing | None, cell: int) -> bool:
        return all(self._free[node] >= self._image + cell * self._held_by(node, size, before) for node in nodes)

    def _held_by(self, node: NodeId, size: int, before: Standing | None) -> int:
        """How many cells a node of a pool of so many has in memory at a time."""
        held = None if before is None else before.pool_of(node)
        is_nothing_new = before is None or (held is not None and held.nodes == 1)
        return 1 if size == 1 and is_nothing_new else CELLS_HELD

    def _can_be(self, after: Standing, before: Standing) -> bool:
        for partition, places in zip(after.division.pools, after.division.ranges, strict=True):
            held = before.pool_of(after.nodes[places.start])
            if held is not None and held.with_epoch(partition.epoch) == partition:
                continue
            for place, size in zip(places, self._bytes_of(partition), strict=True):
                if self._free[after.nodes[place]] < self._image + CELLS_HELD * size:
                    return False
        return True

    def _bytes_of(self, partition: Partition) -> list[int]:
        """What each of its nodes holds at most of the scene: which textures it wears is not known before it is read."""
        textures = range(len(self._tables.textures))
        shares = shares_of(self._tables, partition, range(partition.nodes))
        return [bytes_of(self._tables, share.groups, textures)[0] for share in shares]
