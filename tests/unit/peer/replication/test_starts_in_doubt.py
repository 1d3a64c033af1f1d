"""If one fails, a start makes of what nobody may be told yet what is told as if it counted; or of what counts what is in doubt."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.peer.copies.segment import Change, Segment
from scenefold.peer.line import Line
from scenefold.wire import Configuration
from scenefold.world import World
from scenefold.world.sim import run_simulated
from unit.peer.replication.heirs import Estate, Heir, spread
from unit.peer.replication.terrace import THIRDS, Home, record_at
from unit.peer.replication.writers import Row, in_a_row, until

pytestmark = pytest.mark.expect_log("the connection was cut|was reset by the peer|had no owner any more")


class Starter(Heir):
    """It also sends what is unsettled; nobody is placed."""

    def others(self, world: World, line: Line) -> list[Any]:
        _, *others = Home.others(self, world, line)
        spreading, recovering = self.replication.spreading, self.replication.recovering

        async def run(*, task_status: trio.TaskStatus[None]) -> None:
            async with trio.open_nursery() as nursery:
                await nursery.start(spreading.run)
                await nursery.start(recovering.run)
                task_status.started()

        return [SimpleNamespace(register=self.replication.register, run=run), *others]


class Starters(Estate):
    def house(self, number: int) -> Heir:
        return Starter(self, number)


def test_what_was_recovered_is_not_told_after_a_start_before_enough_have_it() -> None:
    """That everybody was heard says nothing of how many have what one of them had."""

    async def main() -> None:
        estate = Starters(5)
        async with trio.open_nursery() as nursery:
            await estate.begin(nursery)
            arc = await estate.entrust(2, 3)
            records = spread(arc, 4)
            for number in (1, 2, 3):
                await estate.homes[number].keep(*records)
            newer = record_at(records[0].header.location, 2)
            await estate.homes[2].keep(newer)
            await estate.bury(1)
            heir = await estate.adopted(arc)
            await until(lambda: not heir.gaps)
            assert await heir.read(newer.header.location) == (2, True)
            heir.crash()
            await until(lambda: heir.lives == 2 and heir.up.is_set())
            await trio.sleep(1.0)
            assert await heir.read(newer.header.location) == (2, True)
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=500.0, wall_s_max=60.0)


async def started_anew(row: Row) -> bool:
    """Whether anything may be unsettled there now, as it was found on the disk."""
    before = row.owner.lives
    row.owner.crash()
    await until(lambda: row.owner.lives == before + 1 and row.owner.up.is_set())
    await trio.sleep(0.5)
    return row.owner.living.parts.unsettled.is_doubted(THIRDS, row.arc)


def test_where_a_configuration_was_made_a_start_doubts_nothing() -> None:
    """Whatever changes now, and whoever has gone since."""

    async def story(row: Row) -> None:
        assert await started_anew(row), "of places that nobody was ever told to hold"
        await row.hold(1, 2)
        assert not await started_anew(row)
        await row.place(1, 3)
        assert not await started_anew(row)
        await row.place(1, 2)
        (segment,) = row.owner.copies.configurations.segments
        active = segment.active(row.owner.member)
        assert active is not None and segment.leaving > active.number, "one who was to be a holder is to hear that it is none"
        assert not await started_anew(row)
        await row.change(lambda found: found.remove(row.homes[1].member))
        assert not await started_anew(row)

    in_a_row(story, 4)


@pytest.mark.parametrize("is_held", [False, True])
def test_one_that_was_made_before_the_place_was_anothers_counts_only_if_its_holders_are_compared(is_held: bool) -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        me, holder = row.owner.member, row.homes[1].member

        def back(segment: Segment) -> Segment:
            former = Configuration(segment.leaving + 1, (me, holder), 2)
            taken = Segment(THIRDS, segment.arc, (former,), leaving=former.number + 9)
            if not is_held:
                return taken.remove(me, holder, taken.leaving)
            change = Change(taken.leaving + 1, (holder,), 2)
            return replace(taken, change=change, confirmed=frozenset({(holder, former.number)}), sound=frozenset({holder}))

        await row.change(lambda found: replace(found, number=99, segments=tuple(map(back, found.segments))))
        (segment,) = row.owner.copies.configurations.segments
        assert segment.active(me) is not None
        assert await started_anew(row) is not is_held

    in_a_row(story)
