"""Crashes and cuts at every step of a write: what was acknowledged lay on enough disks, and ends on all of them."""

from __future__ import annotations

import random

import pytest
import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.line.ends import Side
from scenefold.peer.records.copying import NotKept
from scenefold.peer.replication import beginning, paying
from scenefold.store import Put
from scenefold.world import DiskFailed
from scenefold.world.sim import Point
from unit.peer.line.street import places
from unit.peer.replication.holders import arc_of
from unit.peer.replication.terrace import record_at
from unit.peer.replication.writers import Row, as_bytes, in_a_row, seq_of, until

pytestmark = pytest.mark.usefixtures("only_errors")


def test_an_owner_that_crashed_before_it_sent_anything_sends_that_first_and_tells_nobody_before() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        # What is owed to one alone is settled, and comes later.
        row.cut_off(2)
        settled = [row.next_at(place) for place in row.places(5)]
        await row.put(*settled)
        row.cut_off(1)
        place = row.places(7)[3]
        record = row.next_at(place)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.tried, record)
            await until(lambda: row.copies_of(record) == 1)
            # What is on its way would come there after all.
            row.net.reset(row.owner.address, row.homes[2].address)
            row.owner.crash()
        await row.awake()
        found = await row.read(place)
        assert found.stale, "nobody knows whether it was acknowledged"
        assert not (await row.read(settled[1].header.location)).stale
        order: list[bool] = []
        holder = row.homes[2]
        row.net.observe(holder.address, Point.AFTER_COMMIT, lambda: order.append(holder.has(record) or not any(map(holder.has, settled))))
        row.mend(2)
        await until(lambda: holder.has(record))
        assert all(order), "what is unsettled comes first"
        await until(lambda: row.is_settled)
        found = await row.read(place)
        assert not found.stale
        assert found.records == (as_bytes(record),)
        row.mend(1)
        await until(lambda: all(row.copies_of(record) == 3 for record in [*settled, record]))
        await until(lambda: not row.owner.debts())

    in_a_row(story)


@pytest.mark.parametrize("point", list(Point))
@pytest.mark.parametrize("who", [0, 1])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_crash_at_any_step_loses_nothing(point: Point, who: int, count: int) -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        records = [row.next_at(place) for place in row.places(6)]
        row.net.trap(row.homes[who].address, point, count, row.homes[who].crash)
        for record in records:
            await row.tried(record)
        row.net.calm()
        await row.awake()
        await until(lambda: row.is_settled)
        for record in records:
            await row.tried(record)
        assert {record.header.location for record in row.acknowledged} == {record.header.location for record in records}
        await until(lambda: all(row.copies_of(record) == 3 for record in row.acknowledged))
        await until(lambda: not row.owner.debts())

    in_a_row(story)


@pytest.mark.parametrize("seed", range(6))
def test_in_any_weather_what_is_acknowledged_is_on_enough_disks_and_what_is_read_never_goes_back(seed: int) -> None:
    async def story(row: Row) -> None:
        dice = random.Random(seed)
        await row.hold(1, 2)
        places = row.places(4)
        is_over = False

        async def write() -> None:
            while not is_over:
                await row.tried(row.next_at(dice.choice(places)))
                await trio.sleep(dice.random())

        async def read() -> None:
            newest = dict.fromkeys(places, 0)
            while not is_over:
                place = dice.choice(places)
                before = max([record.header.seq for record in row.acknowledged if record.header.location == place], default=0)
                try:
                    reply = await row.read(place)
                except (ScenefoldError, DiskFailed):
                    continue
                finally:
                    await trio.sleep(dice.random() / 2)
                if not reply.stale:
                    found = seq_of(reply.records[0])
                    assert found >= max(before, newest[place])
                    newest[place] = found

        async with trio.open_nursery() as nursery:
            for _ in range(3):
                nursery.start_soon(write)
                nursery.start_soon(read)
            for _ in range(12):
                await trio.sleep(4 * dice.random())
                who = dice.randrange(3)
                match dice.randrange(3):
                    case 0:
                        row.homes[who].crash()
                    case 1 if who:
                        row.cut_off(who)
                        await trio.sleep(6 * dice.random())
                        row.mend(who)
                    case _:
                        row.net.machine(row.homes[who].address).disk.slow(dice.random())
            row.net.calm()
            is_over = True
        await row.awake()
        await until(lambda: row.is_settled)
        assert row.acknowledged
        await until(lambda: all(row.copies_of(record) == 3 for record in row.acknowledged))
        await until(lambda: not row.owner.debts())

    in_a_row(story, seed=seed)


def test_a_piece_with_something_unsettled_is_not_let_go_of() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        place = row.places(8)[7]
        record = row.next_at(place)
        piece = Arc(place, row.arc.last)
        await trio.sleep(12.0)
        row.cut_off(2)
        row.net.machine(row.homes[1].address).disk.slow(12.0)
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.given, Side.RIGHT, piece)
            await trio.sleep(4.0)
            assert place in row.arc, "it waits"
            row.net.machine(row.homes[1].address).disk.slow(0.0)
        row.mend(2)
        assert row.homes[1].living.owns(place)
        assert row.copies_of(record) >= 2

    in_a_row(story)


def test_debts_to_who_holds_nothing_there_and_of_others_places_are_forgotten() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        elsewhere = record_at(places(arc_of(row.homes[2]), 3)[1])
        settled = row.next_at(row.places(2)[1])
        store = row.owner.store
        await store.put([Put(settled)], [[NodeId(77), row.homes[1].node]])
        await store.merge([Put(elsewhere)], [[row.homes[1].node]])
        row.owner.crash()
        await until(lambda: row.owner.lives == 2)
        await until(lambda: row.is_settled)
        await until(lambda: not row.owner.debts())
        assert row.homes[1].has(settled)
        assert not row.homes[1].has(elsewhere)

    in_a_row(story)


def test_more_debts_than_a_page_are_all_paid(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        monkeypatch.setattr(paying, "PAGE", 4)
        monkeypatch.setattr(paying, "READ_BATCH", 3)
        await row.hold(1, 2)
        row.cut_off(2)
        records = [row.next_at(place) for place in row.places(30)]
        await row.put(*records)
        row.owner.crash()
        await until(lambda: row.owner.lives == 2)
        await until(lambda: row.is_settled)
        assert len(row.owner.debts()) == 30
        row.mend(2)
        await until(lambda: not row.owner.debts())
        assert all(row.copies_of(record) == 3 for record in records)

    in_a_row(story)


def test_what_nobody_is_owed_is_told_while_what_was_owed_is_still_looked_through(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        monkeypatch.setattr(beginning, "PENDING_MAX", 0)
        await row.hold(1, 2)
        here, owed, later = row.places(3)
        everywhere = row.next_at(here)
        await row.put(everywhere)
        await until(lambda: not row.owner.debts())
        row.cut_off(1, 2)
        doubtful = row.next_at(owed)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.tried, doubtful)
            await until(lambda: row.copies_of(doubtful) == 1)
            row.net.reset(row.owner.address, row.homes[1].address)
            row.net.reset(row.owner.address, row.homes[2].address)
            row.owner.crash()
        await row.awake()
        await trio.sleep(1.0)
        assert not row.owner.living.parts.unsettled.is_read
        assert row.owner.living.parts.unsettled.within(Arc(later, later))
        found = await row.read(here, later)
        assert (found.stale, found.records) == (False, (as_bytes(everywhere), None))
        assert (await row.read(owed)).stale
        assert (await row.listed()).stale
        row.mend(1)
        await until(lambda: row.is_settled)
        found = await row.read(owed)
        assert (found.stale, found.records) == (False, (as_bytes(doubtful),))
        assert not (await row.listed()).stale

    in_a_row(story)


def test_what_is_owed_to_who_has_left_is_forgotten() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        row.cut_off(2)
        record = row.next_at(row.places(1)[0])
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.put, record)
            await until(lambda: row.copies_of(record) >= 1)
            await row.hold(1)
        assert row.acknowledged == [record]
        assert row.owner.debts()
        # What is on its way would come there after all.
        row.net.reset(row.owner.address, row.homes[2].address)
        row.mend(2)
        await until(lambda: not row.owner.debts())
        assert not row.homes[2].has(record)
        later = row.next_at(row.places(2)[1])
        await row.put(later)
        await until(lambda: not row.owner.debts())
        assert row.copies_of(later) == 2

    in_a_row(story)


def test_in_a_degraded_space_what_all_have_who_may_hold_it_is_told_and_not_acknowledged() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        place, other = row.places(2)
        row.cut_off(1, 2)
        async with trio.open_nursery() as nursery:
            record = row.next_at(place)
            nursery.start_soon(row.tried, record)
            await until(lambda: row.copies_of(record) == 1)
            row.net.reset(row.owner.address, row.homes[1].address)
            row.net.reset(row.owner.address, row.homes[2].address)
            row.owner.crash()
        await row.awake()
        # Nobody may hold copies any more, and those who did have heard of that.
        row.mend(1, 2)
        await row.hold()
        await until(lambda: row.is_settled)
        assert (await row.read(place)).records == (as_bytes(record),)
        brought = row.next_at(other)
        merge = row.owner.replication.spreading.merge
        assert isinstance((await merge([Put(brought)]))[0], NotKept), "whoever brings it must not delete its own"
        assert not (await row.read(other)).stale

    in_a_row(story)


def test_that_something_was_paid_may_be_forgotten_and_is_told_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        record = row.next_at(row.places(1)[0])
        paid = row.owner.store.paid

        async def forgotten(_items: object) -> None:
            """As on a full disk."""

        monkeypatch.setattr(row.owner.store, "paid", forgotten)
        row.cut_off(2)
        await row.tried(record)
        row.mend(2)
        await until(lambda: row.copies_of(record) == 3)
        assert row.owner.debts()
        monkeypatch.setattr(row.owner.store, "paid", paid)
        await until(lambda: not row.owner.debts(), 3 * paying.AGAIN_S)

    in_a_row(story)


def test_a_write_that_was_given_up_is_like_one_from_before_a_crash() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        row.cut_off(1, 2)
        record = row.next_at(place)
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        row.mend(1, 2)
        await row.hold()
        await until(lambda: row.is_settled)
        assert (await row.read(place)).records == (as_bytes(record),)
        (again,) = await row.put(record)
        assert again.reason, "fewer have it than its space asks for"

    in_a_row(story)


def test_the_same_again_after_a_crash_is_acknowledged_once_enough_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        # Only the first debt is looked at soon.
        monkeypatch.setattr(beginning, "PENDING_MAX", 0)
        monkeypatch.setattr(beginning, "PAGE", 1)
        await row.hold(1, 2)
        first, doubtful = (row.next_at(place) for place in sorted(row.places(2)))
        row.cut_off(1, 2)
        async with trio.open_nursery() as nursery:
            for record in (first, doubtful):
                nursery.start_soon(row.tried, record)
            await until(lambda: row.copies_of(first) == row.copies_of(doubtful) == 1)
            row.net.reset(row.owner.address, row.homes[1].address)
            row.net.reset(row.owner.address, row.homes[2].address)
            row.owner.crash()
        await row.awake()
        assert not row.owner.living.parts.unsettled.is_read
        other = record_at(doubtful.header.location, 1)
        (refused,) = await row.put(other)
        assert refused.reason == RejectReason.TOO_FEW_COPIES, "that something newer is there must not be known"
        row.mend(1)
        await _offered_until_acknowledged(row, doubtful)
        assert row.copies_of(doubtful) == 2

    in_a_row(story)


async def _offered_until_acknowledged(row: Row, record: Record) -> None:
    """What a client does whose answer was lost. What is acknowledged is looked for on the disks (Row.put)."""
    while record not in row.acknowledged:
        await row.put(record)
        await trio.sleep(0.1)


def test_the_same_again_in_doubt_is_acknowledged_once_enough_have_it() -> None:
    async def story(row: Row) -> None:
        record = row.next_at(row.places(1)[0])
        # As what was found in a gap.
        await row.owner.store.merge([Put(record)])
        row.owner.replication.spreading.doubt(row.arc)
        await row.place(1, 2)
        await row.tell()
        row.cut_off(1, 2)
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        older = record_at(record.header.location, 0)
        (outcome,) = await row.put(older)
        assert outcome.reason == RejectReason.NOT_READY, "that something newer is there must not be known"
        row.mend(2)
        await _offered_until_acknowledged(row, record)
        assert row.copies_of(record) == 2

    in_a_row(story)
