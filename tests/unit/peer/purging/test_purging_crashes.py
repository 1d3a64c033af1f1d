"""If one fails, a crash in the midst of a purge lets something older come back, or keeps what is deleted for ever."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest
import trio

from scenefold.base.errors import ScenefoldError
from scenefold.crypto import Record
from scenefold.store import Put
from scenefold.world import DiskFailed
from scenefold.world.sim import Point
from unit.peer.purging.purgers import Yard, deleted, in_a_yard
from unit.peer.replication.terrace import record_at
from unit.peer.replication.writers import compared, until

pytestmark = pytest.mark.usefixtures("only_errors")

PATIENCE_S = 30.0
OWNER, HOLDER, OTHER = 0, 1, 3


async def insist(yard: Yard, records: Sequence[Record]) -> None:
    """Purge until nothing is there any more. At no moment there is anything older than what was deleted."""
    newest = {record.header.location: record.header.seq for record in records}

    def look() -> None:
        for place, seq in newest.items():
            assert all(version >= seq for found in yard.everywhere(place) for version in found), "something older is back"

    for home in yard.homes:
        yard.net.observe(home.address, Point.AFTER_COMMIT, look)
    while any(any(yard.everywhere(place)) for place in newest):
        await yard.awake()
        with trio.move_on_after(PATIENCE_S):
            try:
                # Which an owner does after each start, and nobody does here by himself.
                await yard.change(compared)
            except (ScenefoldError, DiskFailed) as problem:
                yard.net.note("not compared", problem)
            await yard.purged(*[record for record in records if any(yard.everywhere(record.header.location))])
        await trio.sleep(0.5)


def crashing(number: int, point: Point, count: int) -> bool:
    """A crash of a house at its n-th passing of a point. False if it did not come so far."""
    sprung = False

    async def story(yard: Yard) -> None:
        nonlocal sprung
        records = await deleted(yard, yard.places(2))
        yard.begin_purge()

        def spring() -> None:
            nonlocal sprung
            sprung = True
            yard.homes[number].crash()

        yard.net.trap(yard.homes[number].address, point, count, spring)
        with trio.fail_after(400.0):
            await insist(yard, records)

    in_a_yard(story)
    return sprung


@pytest.mark.parametrize("number", [OWNER, HOLDER, OTHER])
@pytest.mark.parametrize("point", list(Point))
def test_a_crash_at_every_step(number: int, point: Point) -> None:
    count = 1
    while count < 9 and crashing(number, point, count):
        count += 1
    assert count > 1


@pytest.mark.parametrize("seed", range(3))
def test_in_any_weather_nothing_older_comes_back(seed: int) -> None:
    async def story(yard: Yard) -> None:
        dice = random.Random(seed)
        records = await deleted(yard, yard.places(3))
        # Somebody has what was there before.
        away = yard.homes[OTHER]
        await away.store.merge([Put(record_at(record.header.location, record.header.seq - 3)) for record in records])
        yard.begin_purge()
        is_over = False

        async def purge() -> None:
            while not is_over:
                await yard.purged(*records[: dice.randrange(1, 4)])
                await trio.sleep(dice.random())

        def unless_older() -> None:
            for record in records:
                found = yard.everywhere(record.header.location)
                if any(version < record.header.seq for one in found for version in one):
                    assert any(record.header.seq in one for one in found), "it is deleted, and something older is left"

        for home in yard.homes:
            yard.net.observe(home.address, Point.AFTER_COMMIT, unless_older)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(purge)
            for _ in range(10):
                await trio.sleep(6 * dice.random())
                who = dice.randrange(4)
                match dice.randrange(3):
                    case 0:
                        yard.homes[who].crash()
                    case 1 if who:
                        yard.cut_off(who)
                        await trio.sleep(6 * dice.random())
                        yard.mend(who)
                    case _:
                        yard.net.machine(yard.homes[who].address).disk.slow(dice.random())
            yard.net.calm()
            is_over = True
            nursery.cancel_scope.deadline = trio.current_time() + PATIENCE_S
        await yard.awake()
        # The stray comes home to who has something newer.
        older = [home.versions for home in yard.homes]
        await until(lambda: not any(seq < one.header.seq for one in records for of in older for seq in of(one.header.location)), 400.0)
        with trio.fail_after(400.0):
            await insist(yard, records)

    in_a_yard(story, seed=seed)
