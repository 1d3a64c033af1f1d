"""If it fails, readers of an adopted place wait longer than they must (specs/20-copies.md, Recovery)."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenefold.base.location import Arc
from scenefold.peer.line import Line
from scenefold.peer.records.copying import TOLD_S_MAX
from scenefold.wire import ListHeld, Packet
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.replication.heirs import Estate, Heir, inherit, spread, until
from unit.peer.replication.holders import arc_of
from unit.peer.replication.terrace import SPACE, Home

pytestmark = pytest.mark.usefixtures("only_errors")


class Busy(Heir):
    """One that also places, tells, compares and judges, as nodes do."""

    def others(self, world: World, line: Line) -> list[Any]:
        _, *others = super().others(world, line)
        return [self.replication, *others]


class Whole(Estate):
    def house(self, number: int) -> Home:
        return Busy(self, number)


@pytest.mark.parametrize("seed", range(4))
def test_soon_after_it_is_recovered_a_place_is_told_without_doubt(seed: int) -> None:
    """Its former holders answer for it no more from then on: whoever reads it waits for its owner."""

    async def main() -> None:
        estate = Whole(5)
        async with trio.open_nursery() as nursery:
            await estate.begin(nursery)
            arc = await estate.entrust(2, 3)
            records = spread(arc, 60)
            for number in (2, 3):
                await estate.homes[number].keep(*records)
            await estate.bury(1)
            heir = await estate.adopted(arc)
            while heir.gaps:  # noqa: ASYNC110 - the disk tells nobody when it changes
                await trio.sleep(0.01)
            begin = trio.current_time()
            assert await heir.read(records[0].header.location) == (1, False)
            assert trio.current_time() - begin < 0.3
            nursery.cancel_scope.cancel()

    run_simulated(seed, main, virtual_s_max=500.0, wall_s_max=120.0)


def test_who_asks_for_one_place_does_not_wait_behind_all_that_another_one_asks_for() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, slow = estate.homes[2], estate.homes[3]
        *many, one = [record.header.location for record in spread(arc, 200, space=SPACE)]
        listed, senders = slow.handlers._table[ListHeld]

        async def late(packet: ListHeld, peer: str) -> Packet:
            await trio.sleep(0.3 if packet.first == packet.last else 8.0)
            answer: Packet = await listed(packet, peer)
            return answer

        slow.handlers._table[ListHeld] = late, senders
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        recovering = heir.replication.recovering
        await until(lambda: any(asking is not None and asking._begun.is_set() for asking in recovering._askings.values()))
        # By then all others were heard.
        await trio.sleep(2.0)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(recovering.look_up, many, trio.current_time() + TOLD_S_MAX)
            await trio.sleep(0.05)
            await recovering.look_up([one], trio.current_time() + TOLD_S_MAX)
            assert recovering.is_known(one)
            assert not all(map(recovering.is_known, many))
        # Those are looked up a few at a time, until it is late.
        assert 8 < sum(map(recovering.is_known, many)) < len(many)
        assert not heir.copies.is_recovered(Arc(one, one))

    inherit(story)
