"""A write is acknowledged once enough disks have it, and comes to all others behind that (specs/20-copies.md, Writes)."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import object_of, wanted_place
from scenefold.peer.records.copying import NotKept
from scenefold.peer.replication import lane
from scenefold.peer.replication.batch_size import BATCH_BYTES_MIN
from scenefold.peer.replication.placing_wishes import Shortage
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import GetMany, Packet, PutOutcome, RecordKey, StoreCopies
from scenefold.world import Priority
from unit.peer.replication.terrace import HEADER, OBJECTS, SPACE, THIRDS, object_record, record_at
from unit.peer.replication.writers import Row, as_bytes, in_a_row, names, until


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


def test_what_too_few_have_is_refused_in_doubt_and_told_by_nobody_until_they_have_it() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        place, other = row.places(2)
        former = row.next_at(place)
        await row.put(former)
        await until(lambda: row.copies_of(former) == 3)
        row.cut_off(1, 2)
        record = row.next_at(place)
        begin = trio.current_time()
        (outcome,) = await row.put(record)
        assert outcome.reason == RejectReason.NOT_READY
        assert outcome.owner in {row.homes[1].node, row.homes[2].node}, "it may have come there"
        assert 9.9 < trio.current_time() - begin < 10.5
        assert row.copies_of(record) == 1
        # Whoever asks waits for a while, and hears then that it may be stale.
        begin = trio.current_time()
        found = await row.read(place, other)
        assert 1.9 < trio.current_time() - begin < 2.5
        assert found.stale
        assert (await row.listed()).stale
        (refused,) = await row.put(former)
        assert refused.reason == RejectReason.TOO_FEW_COPIES, "that something newer is there must not be known"
        assert row.owner.living.parts.unsettled.within(Arc(place, place))
        assert not row.owner.living.parts.unsettled.within(Arc(other, other))
        row.mend(1, 2)
        await until(lambda: row.copies_of(record) == 3)
        await until(lambda: row.owner.living.parts.unsettled.is_quiet)
        found = await row.read(place, other)
        assert not found.stale
        assert found.records[0] == as_bytes(record)
        assert found.records[1] is None
        (stale,) = await row.put(former)
        assert stale.reason == RejectReason.STALE_VERSION
        assert not (await row.listed()).stale

    in_a_row(story)


def test_the_same_again_waits_until_it_is_settled() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        row.cut_off(1, 2)
        record = row.next_at(place)
        outcomes: list[int] = []

        async def write() -> None:
            (outcome,) = await row.put(record)
            outcomes.append(outcome.reason)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write)
            await trio.sleep(5.0)
            nursery.start_soon(write)
            await trio.sleep(6.0)
            assert outcomes == [RejectReason.NOT_READY]
            row.mend(1)
            await trio.sleep(3.0)
            assert outcomes == [RejectReason.NOT_READY, 0]

    in_a_row(story)


def test_holders_that_are_known_to_be_too_few_are_not_tried() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        row.cut_off(1, 2)
        for number in (1, 2):
            row.owner.roster.note_refusal(row.homes[number].node)
        begin = trio.current_time()
        record = row.next_at(place)
        (outcome,) = await row.put(record)
        # Nothing was stored, and it is another one that is missing: who reads its own id there would look for a lease, or a blacklist.
        assert (outcome.reason, outcome.owner) == (RejectReason.TOO_FEW_COPIES, row.homes[1].node)
        assert trio.current_time() - begin < 1.0
        assert not row.owner.places()
        # What comes from another node is taken: it is in doubt like any other that too few have.
        (brought,) = await row.owner.replication.spreading.merge([Put(record)], wait=False)
        assert brought == PutResult(Outcome.STORED, record.header.digest)
        assert row.owner.has(record)
        (same,) = await row.owner.replication.spreading.merge([Put(record)])
        assert isinstance(same, NotKept)

    in_a_row(story)


def test_nobody_can_hold_copies() -> None:
    async def story(row: Row) -> None:
        await row.hold()
        (place,) = row.places(1)
        row.owner.replication.placing.shortages[THIRDS] = Shortage(THIRDS, 2, 1, row.owner.node)
        (outcome,) = await row.put(row.next_at(place))
        assert (outcome.reason, outcome.owner) == (RejectReason.TOO_FEW_COPIES, row.owner.node)
        assert not row.owner.places()

    in_a_row(story)


def test_one_that_has_not_been_told_its_custody_yet_gets_what_was_written_as_soon_as_it_has() -> None:
    async def story(row: Row) -> None:
        await row.place(1, 2)
        (place,) = row.places(1)
        record = row.next_at(place)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.put, record)
            await until(lambda: row.copies_of(record) == 1)
            await trio.sleep(1.5)
            assert row.copies_of(record) == 1
            begin = trio.current_time()
            await row.tell()
        assert trio.current_time() - begin < 0.9, "it is tried again at once, not after a pause"
        assert row.acknowledged == [record]

    in_a_row(story)


def test_objects_and_records_of_a_space_with_one_copy_in_one_write() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        places = row.places(4)
        alone = record_at(places[0], space=SPACE)
        shared = record_at(places[1])
        thing = object_record(next(name for name in names() if wanted_place(name) in row.arc))
        outcomes = await row.put(alone, shared, thing)
        assert [outcome.reason for outcome in outcomes] == [0, 0, 0]
        assert row.copies_of(alone) == 1
        await until(lambda: row.copies_of(shared) == 3)
        await until(lambda: all(len(home.spots(OBJECTS)) == 1 for home in row.homes))
        await until(lambda: not row.owner.debts())
        newer = object_record(object_of(thing.header), 2)
        row.cut_off(1, 2)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(row.put, newer)
            await trio.sleep(0.5)
            key = RecordKey(OBJECTS, places[2], object_of(thing.header))
            assert (await row.owner.asked(GetMany(HEADER.scene, HEADER.position, (key,)))).stale
            row.mend(1)
        assert not (await row.owner.asked(GetMany(HEADER.scene, HEADER.position, (key,)))).stale

    in_a_row(story)


def test_without_a_lease_nothing_is_acknowledged() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        row.cut_off(1, 2)
        record = row.next_at(place)
        outcomes: list[PutOutcome] = []

        async def write() -> None:
            outcomes.extend(await row.put(record))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(write)
            await trio.sleep(1.0)
            row.owner.leased = False
            row.mend(1, 2)
        assert [outcome.reason for outcome in outcomes] == [RejectReason.NOT_READY]
        assert row.copies_of(record) >= 2, "it is in doubt, and there"

    in_a_row(story)


def test_what_does_not_fit_the_memory_is_paid_from_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        monkeypatch.setattr(lane, "BACKLOG_BYTES_MAX", 500)
        monkeypatch.setattr(lane, "FLIGHTS", 1)
        await row.hold(1, 2)
        row.net.machine(row.homes[2].address).disk.slow(1.0)
        records = [row.next_at(place) for place in row.places(40)]
        async with trio.open_nursery() as nursery:
            for record in records:
                nursery.start_soon(row.put, record)
        assert len(row.acknowledged) == 40
        await until(lambda: all(row.copies_of(record) == 3 for record in records))
        await until(lambda: not row.owner.debts())
        assert row.owner.living.events["debts paid"] > 0

    in_a_row(story)


def test_over_a_slow_link_copies_come_in_smaller_packets() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        ask = row.owner.peers.ask

        async def slow(node: NodeId, priority: Priority, packet: Packet, answer: type[Packet], timeout: float) -> Packet:
            if isinstance(packet, StoreCopies) and len(packet.items) * lane.RECORD_BYTES > 2 * BATCH_BYTES_MIN:
                await trio.sleep(timeout)
                raise Unreachable("no answer in time", where=address_of(node))
            return await ask(node, priority, packet, answer, timeout)

        row.owner.peers.ask = slow  # type: ignore[method-assign,assignment]
        records = list(map(record_at, row.places(400)))
        assert {outcome.reason for outcome in await row.put(*records)} == {RejectReason.NOT_READY}
        await until(lambda: not row.owner.debts(), 200.0)
        assert row.copies_of(records[0]) == row.copies_of(records[-1]) == 3

    in_a_row(story)


def test_what_is_not_stored_yet_is_not_judged_when_its_holders_change() -> None:
    async def story(row: Row) -> None:
        await row.hold(1, 2)
        (place,) = row.places(1)
        row.cut_off(1, 2)
        row.net.machine(row.owner.address).disk.slow(1.0)
        record = row.next_at(place)
        outcomes: list[PutOutcome] = []

        async def write() -> None:
            outcomes.extend(await row.put(record))

        async with trio.open_nursery() as nursery:
            # The disk is busy with this change, behind which the record waits: who holds what is another value before it is there.
            nursery.start_soon(row.place, 2, 1)
            await trio.sleep(0.1)
            nursery.start_soon(row.change, lambda found: found.remove(row.homes[2].member))
            nursery.start_soon(write)
            await trio.sleep(5.0)
            assert outcomes == []
            row.mend(1, 2)
            row.net.machine(row.owner.address).disk.slow(0.0)
        assert [outcome.reason for outcome in outcomes] == [0]

    in_a_row(story)
