"""A write is acknowledged once enough disks have it, and comes to all others behind that (specs/20-copies.md, Writes)."""

from __future__ import annotations

import trio

from scenefold.base.reasons import RejectReason
from unit.peer.replication.writers import Row, in_a_row, until


def test_a_write_is_on_enough_disks_when_it_is_acknowledged_and_soon_on_all() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        records = [row.next_at(place) for place in row.places(20)]
        outcomes = await row.put(*records)
        assert [outcome.reason for outcome in outcomes] == [0] * 20
        await until(lambda: all(row.copies_of(record) == 3 for record in records))
        await until(lambda: not row.owner.debts())
        assert row.owner.living.parts.unsettled.is_quiet

    in_a_row(story)


def test_a_holder_that_is_away_holds_up_nobody_and_is_paid_when_it_is_back() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        away = row.homes[2]
        row.net.cut(row.owner.address, away.address)
        records = [row.next_at(place) for place in row.places(30)]
        begin = trio.current_time()
        for record in records:
            (outcome,) = await row.put(record)
            assert outcome.reason == 0
        assert trio.current_time() - begin < 5.0
        assert not any(away.has(record) for record in records)
        assert len(row.owner.debts()) == 30
        row.net.mend(row.owner.address, away.address)
        await until(lambda: all(away.has(record) for record in records))
        await until(lambda: not row.owner.debts())

    in_a_row(story)


def test_what_too_few_have_is_refused_in_doubt_and_not_told_until_they_have_it() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        for number in (1, 2):
            row.net.cut(row.owner.address, row.homes[number].address)
        record = row.next_at(place)
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        assert outcome.owner in {row.homes[1].node, row.homes[2].node}

    in_a_row(story)
