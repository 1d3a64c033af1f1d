"""If one fails, something deleted comes back, or more goes than was deleted."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, cast

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Put
from scenefold.wire import AskPlaces, DropPurged, HandRecords, PlacesAsked, PlaceState, PurgedDropped, PutMany, StoreCopies, WriterEntry
from unit.peer.line.street import places
from unit.peer.purging.purgers import BEGUN, PURGED, Purger, Yard, deleted, in_a_yard, item_of, order_of
from unit.peer.replication.holders import arc_of
from unit.peer.replication.terrace import HEADER, OBJECTS, THRICE, object_record, record_at
from unit.peer.replication.terrace import item_of as handed
from unit.peer.replication.writers import names, offered, until
from unit.peer.scenes_made import SPACE, STRANGER, WRITER, later_header, sealed

LATER = RejectReason.NOT_READY

pytestmark = pytest.mark.usefixtures("only_errors")


def test_what_is_deleted_goes_from_all_disks_and_what_is_not_named_stays() -> None:
    async def story(yard: Yard) -> None:
        first, second, other = await deleted(yard, yard.places(3))
        yard.begin_purge()
        assert await yard.purge(first, second) == (0, 0)
        assert yard.everywhere(first.header.location) == yard.everywhere(second.header.location) == [[]] * 4
        assert yard.everywhere(other.header.location) == [[other.header.seq]] * 3 + [[]]
        # Again: there is nothing any more, and the rest is asked for without it.
        assert await yard.purge(first, other) == (0, RejectReason.BUSY)
        assert await yard.purge(other) == (0,)
        # And the places take what is new.
        new = sealed(PURGED, location=first.header.location, space=THRICE, nonce=b"new" * 4)
        (outcome,) = await yard.put(new)
        assert outcome.reason == 0
        await until(lambda: yard.copies_of(new) == 3)

    in_a_yard(story)


def test_as_long_as_somebody_is_silent_nothing_goes() -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        yard.begin_purge()
        before = yard.everywhere(record.header.location)
        yard.cut_off(3)
        reply = await yard.told(order_of(record))
        assert reply.reasons == (LATER,)
        assert yard.homes[3].address in reply.text
        assert yard.everywhere(record.header.location) == before
        yard.mend(3)
        assert await yard.purge(record) == (0,)

    in_a_yard(story)


def test_as_long_as_somebody_has_an_older_version_nothing_goes() -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        place = record.header.location
        yard.begin_purge()
        await yard.homes[3].store.merge([Put(record_at(place, record.header.seq - 1))])
        assert await yard.purge(record) == (LATER,)
        assert yard.everywhere(place) == [[record.header.seq]] * 3 + [[record.header.seq - 1]]
        # It is a stray there, and goes when its owner has something newer.
        await until(lambda: yard.homes[3].versions(place) == [])
        assert await yard.purge(record) == (0,)
        assert yard.everywhere(place) == [[]] * 4

    in_a_yard(story)


def test_what_is_written_meanwhile_stays_and_what_is_not_everywhere_waits() -> None:
    async def story(yard: Yard) -> None:
        first, second = await deleted(yard, yard.places(2))
        later = yard.next_at(first.header.location)
        await yard.put(later)
        yard.begin_purge()
        assert await yard.purge(first, second) == (RejectReason.STALE_VERSION, RejectReason.BUSY)
        assert yard.copies_of(later) == 3
        yard.cut_off(2)
        assert await yard.purge(second) == (LATER,)
        yard.mend(2)

    in_a_yard(story)


def test_who_may_not_purge_and_what_must_not_go() -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        with pytest.raises(Refused, match="no purge has begun"):
            await yard.told(order_of(record, position=1))
        yard.begin_purge()
        item = item_of(record)
        young = replace(item, version=replace(item.version, epoch=BEGUN))
        for order, reason in [
            (order_of(record, key=STRANGER), RejectReason.NOT_AUTHORISED),
            (order_of(record, signature=bytes(64)), RejectReason.SIGNATURE_INVALID),
            (order_of(record, items=(replace(item, version=replace(item.version, seq=9)),)), RejectReason.SIGNATURE_INVALID),
            (order_of(record, items=(young,)), RejectReason.ILL_FORMED),
            (order_of(record, position=BEGUN + 1), RejectReason.NOT_READY),
        ]:
            with pytest.raises(Refused) as problem:
                await yard.told(order)
            assert problem.value.reason is reason
        ended = later_header(HEADER, position=BEGUN, write_floor=BEGUN, purged=BEGUN, writers=(WriterEntry(WRITER.key_id, 0, 4),))
        yard.owner.scenes = {HEADER.scene: KnownScene.of(ended)}
        with pytest.raises(Refused) as problem:
            await yard.told(order_of(record))
        assert problem.value.reason is RejectReason.KEY_REVOKED
        yard.begin_purge()
        (elsewhere,) = places(arc_of(yard.homes[1]), 1)
        assert await yard.purge(record, record_at(elsewhere)) == (RejectReason.BUSY, RejectReason.NOT_MY_LOCATION)
        assert yard.copies_of(record) == 3

    in_a_yard(story)


def test_what_comes_too_late_is_not_taken_by_anybody() -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        place, old = record.header.location, record_at(record.header.location, record.header.seq - 1)
        yard.begin_purge()
        assert await yard.purge(record) == (0,)
        owner, holder = yard.owner, yard.homes[1]
        await holder.asked(StoreCopies(owner.member, (handed(old),)), owner.node)
        await owner.asked(HandRecords((handed(old),)), yard.homes[3].node)
        await owner.store.put([Put(old)])
        reply = await owner.asked(PutMany((offered(old),)))
        assert [outcome.reason for outcome in reply.outcomes] == [RejectReason.MODE_FORBIDS]
        assert yard.everywhere(place) == [[]] * 4

    in_a_yard(story)


def test_objects_go_too() -> None:
    async def story(yard: Yard) -> None:
        await yard.hold(1, 2)
        name = next(name for name in names() if (yard.arc.first <= handed(object_record(name)).location <= yard.arc.last))
        for seq in (1, 2):
            await yard.put(object_record(name, seq))
        record = object_record(name, 2)
        await until(lambda: yard.copies_of(record) == 3 and not yard.owner.debts())
        yard.begin_purge()
        assert await yard.purge(record) == (0,)
        assert all(home.spots(OBJECTS) == set() for home in yard.homes)

    in_a_yard(story)


def test_where_a_space_has_one_copy_all_are_asked_as_well() -> None:
    async def story(yard: Yard) -> None:
        place = yard.places(1)[0]
        for seq in (1, 2):
            await yard.put(record_at(place, seq, SPACE))
        record = record_at(place, 2, SPACE)
        yard.begin_purge()
        yard.cut_off(1)
        assert await yard.purge(record) == (LATER,)
        yard.mend(1)
        assert await yard.purge(record) == (0,)
        assert yard.everywhere(place) == [[]] * 4

    in_a_yard(story)


def test_a_node_answers_for_what_it_has_and_drops_only_what_its_process_was_asked_about() -> None:
    async def story(yard: Yard) -> None:
        first, second = await deleted(yard, yard.places(2))
        yard.begin_purge()
        owner, holder = yard.owner, yard.homes[1]
        position = yard.log.registry.position
        ask = partial(AskPlaces, owner.member, holder.member)

        async def asked(packet: AskPlaces) -> PlacesAsked:
            reply: PlacesAsked = await holder.asked(packet, owner.node)
            return reply

        order = order_of(first, record_at(second.header.location, second.header.seq - 1))
        reply = await asked(ask(position, order))
        assert (reply.reason, reply.states) == (0, (PlaceState.THIS, PlaceState.OTHER))
        assert (await asked(ask(position, None))).boot == reply.boot
        assert (await asked(ask(position - 1, order))).reason == RejectReason.POSITION_BEHIND
        assert (await asked(ask(position + 1, order))).reason == RejectReason.POSITION_BEHIND
        assert (await asked(AskPlaces(owner.member, owner.member, position, order))).reason == RejectReason.WRONG_INCARNATION
        assert (await holder.asked(ask(position, order), yard.homes[3].node)).reason == RejectReason.NOT_AUTHORISED

        async def dropped(boot: int, record: Record) -> int:
            packet = DropPurged(owner.member, holder.member, boot, HEADER.scene, (item_of(record),))
            answer: PurgedDropped = await holder.asked(packet, owner.node)
            return answer.reason

        assert await dropped(reply.boot, second) == LATER
        assert await dropped(reply.boot + 1, first) == LATER
        assert await dropped(reply.boot, first) == 0
        assert await dropped(reply.boot, first) == 0
        assert holder.versions(first.header.location) == []
        assert holder.versions(second.header.location) == [second.header.seq]

    in_a_yard(story)


def test_who_started_anew_between_the_two_questions_may_have_taken_something_older(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        yard.begin_purge()
        purging = cast(Purger, yard.owner).purging
        ask_again = purging._ask_again

        async def crashing(*details: Any) -> None:
            if yard.homes[3].lives == 1:
                yard.homes[3].crash()
                await until(lambda: yard.homes[3].lives == 2 and yard.homes[3].up.is_set())
            await ask_again(*details)

        monkeypatch.setattr(purging, "_ask_again", crashing)
        before = yard.everywhere(record.header.location)
        assert await yard.purge(record) == (LATER,)
        assert yard.everywhere(record.header.location) == before
        assert await yard.purge(record) == (0,)

    in_a_yard(story)


def test_while_records_are_on_their_way_somewhere_nobody_says_that_it_has_nothing() -> None:
    async def story(yard: Yard) -> None:
        (record,) = await deleted(yard, yard.places(1))
        yard.begin_purge()
        carrying = yard.homes[3].living.parts.carrying
        async with trio.open_nursery() as nursery:
            with carrying.begun():
                assert await yard.purge(record) == (LATER,)
                nursery.start_soon(yard.purge, record)
                await trio.sleep(1.0)
                assert yard.copies_of(record) == 3
                with carrying.begun():
                    pass
            with carrying.begun():
                # What is sent from now on was read after the node was asked.
                await until(lambda: yard.copies_of(record) == 0)

    in_a_yard(story)
