"""One node's cell of one partition, or all of space, with all that tracing in it takes. It is replaced as a whole (specs/29-moving-cells.md)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import trio

from scenefold.partition import Partition
from scenefold.render.arrays import U32
from scenefold.render.contract import RoutingTracer, Tracer


class Cell:
    """Tracers, one a thread, and how many of them work. From the Trio thread only."""

    def __init__(self, partition: Partition, tracers: Sequence[Tracer], place: int | None = None) -> None:
        """`place`: of a node that holds the whole scene, so that no ray leaves it."""
        self.partition = partition
        self._place = place
        self.tracers = tracers
        self._working = 0
        self._rested = trio.Event()

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
        return self._place is not None or all(isinstance(tracer, RoutingTracer) for tracer in self.tracers)

    def route(self, rays: U32) -> dict[int, U32]:
        """By the node of the partition that casts each next."""
        if self._place is not None:
            return {self._place: rays}
        tracer = self.tracers[0]
        assert isinstance(tracer, RoutingTracer), "only those that can route fetch another cell"
        return tracer.route(rays)
