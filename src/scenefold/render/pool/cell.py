"""One node's cell of one division, with all that tracing in it takes. It is replaced as a whole (specs/29-moving-cells.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import trio

from scenefold.partition.division import Division
from scenefold.render.arrays import U32
from scenefold.render.contract import RoutingTracer, Tracer


class Cell:
    """Tracers, one a thread, and how many of them work. From the Trio thread only."""

    def __init__(self, division: Division, place: int, tracers: Sequence[Tracer]) -> None:
        """`place`: the node's, whose pool passes rays on among its own nodes alone (specs/36-render-pools.md)."""
        self.division, self.place = division, place
        self.pool = division.ranges[division.pool_at(place)]
        """Places of all nodes of the pool."""
        self.tracers = tracers
        self._working = 0
        self._rested = trio.Event()

    @property
    def epoch(self) -> int:
        """Of the division."""
        return self.division.epoch

    @contextmanager
    def at_work(self) -> Iterator[None]:
        """A tracer is at work."""
        if not self._working:
            self._rested = trio.Event()
        self._working += 1
        try:
            yield
        finally:
            self._working -= 1
            if not self._working:
                self._rested.set()

    async def at_rest(self) -> None:
        """Return once none of them works. Nobody begins any more."""
        if self._working:
            await self._rested.wait()

    @property
    def can_route(self) -> bool:
        """Whether its rays can be addressed anew."""
        return len(self.pool) == 1 or all(isinstance(tracer, RoutingTracer) for tracer in self.tracers)

    def by_place(self, rays: Mapping[int, U32]) -> dict[int, U32]:
        """What a tracer gave by the nodes of its partition, by their places."""
        return {self.pool.start + index: some for index, some in rays.items()}

    def route(self, rays: U32) -> dict[int, U32]:
        """By the place of the node that casts each next."""
        if len(self.pool) == 1:
            return {self.pool.start: rays}
        tracer = self.tracers[0]
        assert isinstance(tracer, RoutingTracer), "only those that can route fetch another cell"
        return self.by_place(tracer.route(rays))
