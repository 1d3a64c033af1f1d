"""What happens to links between nodes: partitions, cuts in one direction, clogs, resets (specs/17-simulation.md, Faults)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import trio

from scenefold.simulation.cluster import Cluster
from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.overlaps import Overlaps

LOOK_S = 0.5
"""Between two looks whether both ends of a link run."""


class LinkFaults:
    """Those of a storm. `begins` and `ends` are told of a fault once it takes effect; `is_over` says whether the storm is."""

    def __init__(
        self, cluster: Cluster, begins: Callable[[Fault], None], ends: Callable[[Fault], None], is_over: Callable[[], bool]
    ) -> None:
        self._cluster = cluster
        self._net = cluster.net
        self._reach = cluster.watch.reach
        self._begins = begins
        self._ends = ends
        self._is_over = is_over
        self._clogs: Overlaps[tuple[str, str]] = Overlaps()

    async def befall(self, fault: Fault) -> None:
        """Make it happen now."""
        match fault.kind:
            case Kind.PARTITION | Kind.CUT_IN_REPAIR:
                await self._partition(fault)
            case Kind.RESET:
                await self._reset(fault)
            case _:
                await self._cut(fault)

    @contextmanager
    def apart(self, pairs: list[tuple[int, int]]) -> Iterator[None]:
        """The observer knows that these cannot talk."""
        for pair in pairs:
            self._reach.cut(*pair, self._net.now)
        try:
            yield
        finally:
            for pair in pairs:
                self._reach.mended(*pair, self._net.now)

    async def _partition(self, fault: Fault) -> None:
        slots = list(self._cluster.nodes)
        others = [slot for slot in slots if slot not in fault.slots]
        groups = [[self._cluster.nodes[slot].address for slot in group] for group in (fault.slots, others)]
        self._begins(fault)
        with self.apart([(one, other) for one in fault.slots for other in others]):
            partition = self._net.partition(*groups)
            await trio.sleep_until(fault.end_s)
            self._net.unite(partition)
        self._ends(fault)

    async def _cut(self, fault: Fault) -> None:
        """One way is enough: who is heard and cannot be answered gets no lease, and no proof that it lives."""
        one, other = fault.slots
        path = self._cluster.nodes[one].address, self._cluster.nodes[other].address
        with self.apart([(one, other)]):
            if fault.kind is Kind.ONE_WAY:
                self._net.cut(*path, one_way=True)
            elif self._clogs.begin(path, fault):
                self._net.clog(*path)
            has_begun = await self._until_both_run(fault)
            await trio.sleep_until(fault.end_s)
            if self._is_over():
                return
            if fault.kind is Kind.ONE_WAY:
                self._net.mend(*path, one_way=True)
            elif self._clogs.end(path, fault):
                self._net.unclog(*path)
        if has_begun:
            self._ends(fault)

    async def _until_both_run(self, fault: Fault) -> bool:
        """Between two that are dead there is nothing to cut: a fault counts from when both run, if they ever do before its end."""
        with trio.move_on_at(fault.end_s):
            while not self._cluster.running.keys() >= set(fault.slots):  # noqa: ASYNC110 - nobody is told when a node comes up
                await trio.sleep(LOOK_S)
            self._begins(fault)
            return True
        return False

    async def _reset(self, fault: Fault) -> None:
        one, other = (self._cluster.nodes[slot].address for slot in fault.slots)
        has_begun = False
        for _ in range(int(fault.amount)):
            if self._net.reset(one, other) and not has_begun:
                has_begun = True
                self._begins(fault)
            await trio.sleep((fault.end_s - fault.begin_s) / fault.amount)
