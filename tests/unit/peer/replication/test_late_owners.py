"""If one fails, an owner whose disk is an older one brings to others what was purged meanwhile (specs/22-purge.md, Arrival)."""

from __future__ import annotations

from typing import Any

import trio

from scenefold.peer.line import Line
from scenefold.store import Put
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.line.street import places
from unit.peer.replication.terrace import Home, Terrace, record_at
from unit.peer.replication.test_comparing import arc_of, lies_with_all
from unit.peer.replication.test_placing import until
from unit.peer.replication.writers import Row, in_a_row


class Late(Home):
    def others(self, world: World, line: Line) -> list[Any]:
        line.parts.arrival.begin()
        return super().others(world, line)


class LateTerrace(Terrace):
    """`homes[0]` does not know yet whether its disk is an older one."""

    def house(self, number: int) -> Home:
        return super().house(number) if number else Late(self, number)


def test_an_owner_that_has_not_arrived_compares_with_nobody() -> None:
    async def main() -> None:
        terrace = LateTerrace(4)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            owner, *others = terrace.homes
            spots = places(arc_of(owner), 20)
            await owner.store.put([Put(record_at(place)) for place in spots])
            owner.replication.comparing.check_all()
            await trio.sleep(30.0)
            assert not any(home.places() for home in others)
            owner.living.parts.arrival.end()
            await until(lambda: lies_with_all(terrace, owner, spots))
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=600.0, wall_s_max=240.0)


def test_nor_does_it_send_what_it_owes() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        row.owner.living.parts.arrival.begin()
        record = row.next_at(row.places(1)[0])
        await row.owner.replication.spreading.merge([Put(record)], wait=False)
        await trio.sleep(30.0)
        assert row.copies_of(record) == 1
        row.owner.living.parts.arrival.end()
        await until(lambda: row.copies_of(record) == 3)

    in_a_row(story)
