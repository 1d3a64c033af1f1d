"""What befalls clients: their machines are cut off, stand still, or have a clock that runs wrong (specs/17-simulation.md, Faults).

What a client was told before it was cut off, or fell asleep, it still believes when it is back: leases above all.
"""

from __future__ import annotations

from collections.abc import Callable

import trio

from scenefold.simulation.cluster import Cluster
from scenefold.simulation.faults import CLIENTS, Fault, Kind
from scenefold.simulation.overlaps import Overlaps
from scenefold.simulation.workload import client_name

WHOLLY = 0.5
"""Above that a cut-off client reaches no node; below, it is the share of those that it does not reach."""


class ClientFaults:
    """Those of a storm. `begins` and `ends` are told of a fault; `is_over` says whether the storm is."""

    def __init__(
        self, cluster: Cluster, begins: Callable[[Fault], None], ends: Callable[[Fault], None], is_over: Callable[[], bool]
    ) -> None:
        self._cluster, self._net = cluster, cluster.net
        self._begins, self._ends, self._is_over = begins, ends, is_over
        self._rates: Overlaps[tuple[int, Kind]] = Overlaps()
        self._changed: set[str] = set()

    async def befall(self, fault: Fault) -> None:
        """Make it happen now."""
        name = client_name(fault.slots[0] % CLIENTS)
        self._begins(fault)
        match fault.kind:
            case Kind.CUT_CLIENT:
                await self._cut(fault, name)
            case Kind.PAUSED_CLIENT:
                self._net.pause(name, fault.end_s - fault.begin_s)
                await trio.sleep_until(fault.end_s)
            case _:
                await self._misclock(fault, name)
        self._ends(fault)

    def end(self) -> None:
        """What the network does not heal by itself."""
        for name in sorted(self._changed):
            self._net.machine(name).clock.set_rate(1.0)

    async def _cut(self, fault: Fault, name: str) -> None:
        nodes = [node.address for node in self._cluster.nodes.values()]
        count = len(nodes) if fault.amount > WHOLLY else max(1, round(fault.amount * len(nodes)))
        first = fault.slots[0] % len(nodes)
        partition = self._net.partition([*nodes[first:], *nodes[:first]][:count], [name])
        await trio.sleep_until(fault.end_s)
        if not self._is_over():
            self._net.unite(partition)

    async def _misclock(self, fault: Fault, name: str) -> None:
        target = fault.slots[0] % CLIENTS, fault.kind
        self._changed.add(name)
        self._rates.begin(target, fault)
        self._lay(name, target)
        await trio.sleep_until(fault.end_s)
        if not self._is_over():
            self._rates.end(target, fault)
            self._lay(name, target)

    def _lay(self, name: str, target: tuple[int, Kind]) -> None:
        self._net.machine(name).clock.set_rate(1.0 + (self._rates.worst(target) or 0.0))
