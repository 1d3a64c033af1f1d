"""What is read, or written again, where nobody knows who has it, counts once it settles by itself (specs/20-copies.md, Recovery)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.crypto import Record
from scenefold.peer.replication import sending_again
from scenefold.store import Put, PutResult, Spot
from scenefold.wire import GetMany, PutOutcome, RecordKey
from unit.peer.replication.terrace import HEADER, SPACE, record_at
from unit.peer.replication.writers import Row, as_bytes, compared, in_a_row, until


async def adopted(row: Row, *holders: int) -> None:
    """As if it had adopted the piece: nobody is compared. These are to hold it now."""
    await row.place(*holders)
    await row.change(lambda found: replace(found, segments=tuple(replace(one, sound=frozenset()) for one in found.segments)))
    row.owner.replication.spreading.doubt(row.arc)


async def doubted(row: Row, *holders: int) -> None:
    """Likewise, and they know that."""
    await adopted(row, *holders)
    await row.tell()


async def everywhere(row: Row) -> tuple[Location, Record]:
    """A place, and what lies there at all who hold it."""
    await row.hold(1, 2)
    (place,) = row.places(1)
    record = row.next_at(place)
    await row.put(record)
    await until(lambda: not row.owner.debts())
    return place, record


async def alone(row: Row) -> tuple[Location, Record]:
    """A place that is doubted, and what lies there at its owner alone, which reaches nobody."""
    await row.hold(1, 2)
    (place,) = row.places(1)
    record = row.next_at(place)
    await row.owner.living.parts.store.put([Put(record)])
    await doubted(row, 1, 2)
    row.cut_off(1, 2)
    return place, record


def test_a_doubted_piece_is_told_again_when_all_who_hold_it_are_compared() -> None:
    async def story(row: Row) -> None:
        place, record = await everywhere(row)
        await adopted(row, 1)
        row.cut_off(1, 2)
        assert (await row.read(place)).stale
        assert (await row.listed()).stale
        row.mend(1, 2)
        assert row.owner.living.parts.unsettled.within(row.arc)
        await row.put(record_at(place, space=SPACE))
        key = RecordKey(SPACE, place, b"")
        assert not (await row.owner.asked(GetMany(HEADER.scene, HEADER.position, (key,)))).stale
        await row.tell()
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.change, compared)
            found = await row.read(place)
        assert (found.stale, found.records) == (False, (as_bytes(record),))
        assert not row.owner.living.parts.unsettled.within(row.arc)

    in_a_row(story)


def test_what_is_read_in_a_doubted_piece_is_told_as_soon_as_enough_have_it() -> None:
    """Else a reader waits until all of an adopted piece is compared, while its former holders do not answer any more either."""

    async def story(row: Row) -> None:
        await row.hold(1, 2)
        read, written, other = row.places(3)
        record, later = row.next_at(read), row.next_at(written)
        await row.put(record, later)
        await until(lambda: not row.owner.debts())
        await doubted(row, 1, 2)
        begin = trio.current_time()
        found = await row.read(read)
        assert (found.stale, found.records) == (False, (as_bytes(record),))
        newer = row.next_at(written)
        assert [outcome.reason for outcome in await row.put(newer)] == [0]
        found = await row.read(written, other)
        assert (found.stale, found.records) == (False, (as_bytes(newer), None))
        # Nobody can say that he read it once: it may have settled alone.
        assert not (await row.read(read, written)).stale
        assert trio.current_time() - begin < 0.5
        assert row.owner.living.parts.unsettled.doubts and len(row.owner.living.parts.unsettled) == 0
        assert (await row.listed()).stale, "of the whole piece nobody knows yet"

    in_a_row(story)


def test_what_is_read_in_a_doubted_piece_is_not_told_while_too_few_have_it() -> None:
    async def story(row: Row) -> None:
        place, _ = await everywhere(row)
        await doubted(row, 1, 2)
        row.cut_off(1, 2)
        begin = trio.current_time()
        assert (await row.read(place)).stale
        assert 1.9 < trio.current_time() - begin < 2.5
        row.mend(2)
        await until(lambda: len(row.owner.living.parts.unsettled) == 0)
        begin = trio.current_time()
        assert not (await row.read(place)).stale
        assert trio.current_time() - begin < 0.5

    in_a_row(story)


def test_so_much_is_read_in_a_doubted_piece_that_the_rest_waits_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sending_again, "SENT_MAX", 2)

    async def story(row: Row) -> None:
        await row.hold(1, 2)
        places = row.places(3)
        records = [row.next_at(place) for place in places]
        await row.put(*records)
        await until(lambda: not row.owner.debts())
        await doubted(row, 1, 2)
        assert (await row.read(*places)).stale
        assert not (await row.read(*places[:2])).stale
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.change, compared)
            assert not (await row.read(*places)).stale

    in_a_row(story)


def test_what_is_not_recovered_is_not_sent_to_anybody() -> None:
    """Who is to hold it is not known, and what lies here may not be the newest."""

    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        await row.put(row.next_at(place))
        await until(lambda: not row.owner.debts())
        await doubted(row, 1, 2)
        keeper = row.owner.living.parts.keeper
        await keeper.change_copies(lambda copies, _: replace(copies, unrecovered=(row.arc,)))
        assert (await row.read(place)).stale
        assert len(row.owner.living.parts.unsettled) == 0

    in_a_row(story)


def slowly(monkeypatch: pytest.MonkeyPatch, row: Row, seconds: float) -> None:
    """The next one who asks the owner's store who is owed what gets the answer so late."""
    store, late = row.owner.living.parts.store, iter([seconds])
    debtors_of = store.debtors_of

    async def asked(spots: Sequence[Spot]) -> list[tuple[NodeId, ...]]:
        found = await debtors_of(spots)
        await trio.sleep(next(late, 0.0))
        return found

    monkeypatch.setattr(store, "debtors_of", asked)


def test_the_same_again_is_not_acknowledged_because_somebody_reads_it_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """What he reads is sent, and is no more settled by that than by the write."""

    async def story(row: Row) -> None:
        place, record = await alone(row)
        slowly(monkeypatch, row, 0.3)
        outcomes: list[PutOutcome] = []

        async def write() -> None:
            outcomes.extend(await row.put(record))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write)
            await trio.sleep(0.15)
            assert (await row.read(place)).stale
            assert not outcomes
            row.mend(1, 2)
        assert [outcome.reason for outcome in outcomes] == [0]

    in_a_row(story)


def test_the_same_twice_at_once_is_acknowledged_to_neither_before_it_is_settled(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        _, record = await alone(row)
        slowly(monkeypatch, row, 0.3)
        outcomes: list[PutOutcome] = []

        async def write() -> None:
            outcomes.extend(await row.put(record))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write)
            await trio.sleep(0.15)
            nursery.start_soon(write)
            await trio.sleep(2.0)
            assert not outcomes
            row.mend(1, 2)
        assert [outcome.reason for outcome in outcomes] == [0, 0]

    in_a_row(story)


def test_what_is_read_is_not_told_because_somebody_writes_the_same_again_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """That it was not stored once more settles nothing."""

    async def story(row: Row) -> None:
        place, record = await alone(row)
        slowly(monkeypatch, row, 0.3)
        store = row.owner.living.parts.store
        put = store.put

        async def put_late(puts: Sequence[Put], debtors: Sequence[Sequence[NodeId]]) -> list[PutResult]:
            await trio.sleep(0.5)
            return await put(puts, debtors)

        monkeypatch.setattr(store, "put", put_late)

        async def read() -> None:
            assert (await row.read(place)).stale
            assert row.copies_of(record) == 1
            row.mend(1, 2)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(read)
            await trio.sleep(0.1)
            await row.put(record)

    in_a_row(story)


def test_what_is_given_away_while_somebody_reads_it_is_sent_to_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be pending as long as this node runs."""

    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        await row.put(row.next_at(place))
        await until(lambda: not row.owner.debts())
        await doubted(row, 1, 2)
        slowly(monkeypatch, row, 0.5)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.read, place)
            await trio.sleep(0.1)
            await row.change(lambda found: replace(found, segments=()))
            unsettled = row.owner.living.parts.unsettled
            for doubt in unsettled.doubts:
                unsettled.clear(doubt.layout, doubt.arc, doubt.rules)
        assert len(row.owner.living.parts.unsettled) == 0

    in_a_row(story)
