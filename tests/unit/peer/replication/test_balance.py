"""If this fails, bounds of nodes that hold copies for each other do not come to rest, or where some own much more than others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import trio

from scenefold.peer.balance import Balancer, OwnLoad
from scenefold.peer.balance.policy import BYTES_MIN
from scenefold.peer.line import Gaps, Line
from scenefold.store import Put
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import Home, Terrace, record_at

NODES = 5
RECORDS = 120
PAYLOAD = b"p" * 16_000
FAR_FROM_EVEN = BYTES_MIN // len(PAYLOAD) + 1
"""Records that balance leaves alone."""


class Weigher(Home):
    """It balances."""

    balancer: Balancer

    def others(self, world: World, line: Line) -> list[Any]:
        parts = line.parts
        gaps = Gaps(world.clock, self.roster)
        self.balancer = Balancer(world, parts.store, line, self.roster, self.street.log, parts.own, parts.resting, gaps)
        load = OwnLoad(world.clock, parts.store, lambda: line.arc, lambda: parts.keeper.copies.custody, 0)

        async def balance(*, task_status: trio.TaskStatus[None]) -> None:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self.balancer.run)
                task_status.started()
                while True:
                    used, capacity = await load.look()
                    parts.own.update(disk_used_bytes=used, disk_total_bytes=capacity)
                    await trio.sleep(1.0)

        return [*super().others(world, line), SimpleNamespace(register=lambda _: None, run=balance)]


class Seesaw(Terrace):
    homes: list[Any]

    def house(self, number: int) -> Home:
        return Weigher(self, number)

    async def until_held(self) -> None:
        """Return once every house has said who holds what it owns."""
        while not all(home.copies.configurations.segments for home in self.homes):  # noqa: ASYNC110 - nobody tells
            await trio.sleep(0.5)


def test_what_one_owns_spreads_and_bounds_come_to_rest() -> None:
    async def main() -> None:
        terrace = Seesaw(NODES)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            await terrace.until_held()
            first = terrace.homes[0]
            written = places(first.living.arc, RECORDS)
            await first.replication.spreading.merge([Put(record_at(place, payload=PAYLOAD)) for place in written])
            await trio.sleep(300.0)
            arcs = [home.living.arc for home in terrace.homes]
            owned = [sum(place in arc for place in written) for arc in arcs]
            assert all(abs(count - RECORDS // NODES) <= FAR_FROM_EVEN for count in owned), owned
            await trio.sleep(300.0)
            assert [home.living.arc for home in terrace.homes] == arcs
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1_000.0, wall_s_max=120.0)
