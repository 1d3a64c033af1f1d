"""What a node knows of empty space in a job, over which it passes rays (specs/28-rebalancing.md, Empty space)."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.partition import Partition
from scenefold.render.arrays import U8, EmptySpace
from scenefold.render.contract import SkippingTracer, Tracer
from scenefold.render.occupied import empty_space, mark, nothing_occupied, packed, pieces_of, unpacked
from scenefold.render.pool.share import LANE, LoadedShare
from scenefold.world import Workers


class Emptiness:
    """Of one part. Nothing is known before all nodes have told where they hold something."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._occupied: U8 | None = None
        self._space: EmptySpace | None = None
        self.told = b""
        """Where this node holds something, until all is known; empty if its tracers pass rays over nothing."""

    async def find(self, loaded: LoadedShare, cells: Partition, me: int, tracers: Sequence[Tracer]) -> None:
        """Where this node holds something, for the organiser. Of a node without neighbours nobody needs to know."""
        if cells.nodes > 1 and all(isinstance(tracer, SkippingTracer) for tracer in tracers):
            self.told = packed(await self._of(loaded, cells, me))

    async def see(self, told: object, loaded: LoadedShare, tracers: Sequence[Tracer]) -> None:
        """Where any node holds something; nothing is traced yet. PeerFault if that is ill-formed, Refused (16) if this one holds something elsewhere."""
        occupied = unpacked(told)
        if self.told and (unpacked(self.told) > occupied).any():
            raise changed()
        self._space = await self._workers.run(LANE, empty_space, loaded.tables, occupied)
        self._occupied, self.told = occupied, b""
        self.use_in(tracers)

    async def check(self, loaded: LoadedShare, cells: Partition, me: int) -> None:
        """Refused (16) if something lies where nothing was: rays that are under way were passed over it."""
        if self._occupied is not None and (await self._of(loaded, cells, me) > self._occupied).any():
            raise changed()

    def use_in(self, tracers: Sequence[Tracer]) -> None:
        """Of another cell, before anything is traced in it."""
        for tracer in tracers:
            if self._space is not None and isinstance(tracer, SkippingTracer):
                tracer.skip(self._space)

    async def _of(self, loaded: LoadedShare, cells: Partition, me: int) -> U8:
        occupied = nothing_occupied()
        for pairs in await self._workers.run(LANE, pieces_of, loaded.tables, cells, me):
            await self._workers.run(LANE, mark, occupied, loaded.tables, loaded.held.arrays, pairs)
        return occupied


def changed() -> Refused:
    """Somebody edits the scene: rays may be passed over what is there by now."""
    return Refused(RejectReason.NOT_READY, "the scene was changed while it is rendered", remedy="start the render again")
