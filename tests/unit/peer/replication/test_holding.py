"""If one fails, a holder keeps what nobody told it to, confirms what it has not, or answers for what it has no right to."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import wanted_place
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.numbers import first_number
from scenefold.peer.replication.recovering_walk import Walk
from scenefold.store import Put
from scenefold.wire import StoreCopies
from unit.peer.line.street import rot
from unit.peer.replication.holders import arc_of, entrust, entry, listing, pages, play, send, some_places, tell, word
from unit.peer.replication.terrace import HEADER, OBJECTS, SPACE, THIRDS, Terrace, item_of, object_record, record_at
from unit.peer.replication.test_placing import until
from unit.peer.scenes_made import STRANGER, sealed

NOT_MINE, BEHIND, ILL, NOT_READY, WRONG, BUSY = (
    RejectReason.NOT_MY_LOCATION,
    RejectReason.POSITION_BEHIND,
    RejectReason.ILL_FORMED,
    RejectReason.NOT_READY,
    RejectReason.WRONG_INCARNATION,
    RejectReason.BUSY,
)


@pytest.mark.expect_log("the connection was cut")
def test_custody_is_durable_before_it_is_confirmed_and_lasts() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        kept = holder.durable_copies().custody
        assert [(found.arc, found.number, found.whole) for found in kept.entries] == [(arc_of(owner), 5, True)]
        assert (await tell(owner, holder, 5, entry(5, arc_of(owner), kept.entries[0].members))).reason == 0, "again"
        holder.crash()
        await trio.sleep(3.0)
        await holder.up.wait()
        assert holder.copies.custody == kept
        assert (await tell(owner, holder, 6)).reason == 0
        assert holder.durable_copies().custody.entries == ()
        behind = await tell(owner, holder, 5, entry(5, arc_of(owner), kept.entries[0].members))
        assert (behind.reason, behind.number) == (BEHIND, 6)

    play(story)


def test_who_sets_custody_is_who_it_says_and_owns_the_place() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = terrace.homes
        members = owner.member, holder.member
        half = Arc(arc_of(owner).first, Location.from_number(arc_of(owner).last.number // 2))
        said = word(owner, holder, 5, entry(5, half, members), scope=half)
        assert (await holder.asked(said, other.node)).reason == RejectReason.NOT_AUTHORISED
        assert (await holder.asked(replace(said, holder=other.member), owner.node)).reason == WRONG
        beyond = first_number(owner.street.log.registry.position + 1)
        assert (await holder.asked(replace(said, number=beyond), owner.node)).reason == ILL, "who recovers it begins there, or below"
        stolen = word(other, holder, 5, entry(5, half, (other.member, holder.member)), scope=half)
        assert (await holder.asked(stolen, other.node)).reason == NOT_READY, "it is another's place"
        mine = arc_of(holder)
        lie = word(owner, holder, 5, entry(5, mine, members), scope=mine)
        assert (await holder.asked(lie, owner.node)).reason == NOT_READY
        foreign = word(owner, holder, 5, entry(5, half, (owner.member, other.member)), scope=half)
        assert (await holder.asked(foreign, owner.node)).reason == ILL, "whole, and no member"
        with pytest.raises(Refused, match="may not send"):
            await holder.asked(said)
        assert holder.copies == Copies.of(holder.member)
        assert (await holder.asked(said, owner.node)).reason == 0

    play(story)


def test_what_is_held_for_one_is_not_taken_over_by_who_only_claims_its_place() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = await entrust(terrace)
        assert owner.own is not None
        assert other.own is not None
        arc = arc_of(owner)
        kept = holder.copies.custody
        other.own.arc = arc
        stolen = word(other, holder, 6, entry(6, arc, (other.member, holder.member)), scope=arc)
        await until(lambda: holder.roster.arcs()[other.node] == arc)
        refused = await holder.asked(stolen, other.node)
        assert (refused.reason, holder.copies.custody) == (NOT_READY, kept)
        assert "held for that node" in refused.text
        assert await send(owner, holder, record_at(some_places(owner, 1)[0])) == (0,)
        owner.own.arc = None
        await until(lambda: holder.roster.arcs()[owner.node] is None)
        assert (await holder.asked(stolen, other.node)).reason == 0

    play(story)


def test_copies_are_kept_for_the_owner_that_was_given_custody_and_for_no_other() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = terrace.homes
        spot, another = some_places(owner, 2)
        assert await send(owner, holder, record_at(spot)) == (NOT_MINE,)
        await entrust(terrace)
        foreign = some_places(other, 1)[0]
        forged = sealed(HEADER, STRANGER, location=another, space=record_at(another).header.space)
        answers = await send(owner, holder, record_at(spot, 2), record_at(foreign), forged, record_at(another, space=SPACE))
        assert answers == (0, NOT_MINE, RejectReason.NOT_AUTHORISED, NOT_MINE)
        assert holder.places() == {spot}
        assert await send(owner, holder, record_at(spot, 1)) == (0,), "something newer is there"
        (kept,) = await holder.store.read([holder.spot(spot)])
        assert kept.header.seq == 2
        with pytest.raises(Refused, match="in the name of"):
            await holder.asked(StoreCopies(owner.member, (item_of(record_at(another)),)), other.node)
        for_itself = StoreCopies(other.member, (item_of(record_at(another)),))
        assert (await holder.asked(for_itself, other.node)).reasons == (NOT_MINE,)

    play(story)


def test_an_object_lies_at_its_home_at_a_holder_wherever_its_owner_has_put_it() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        name = bytes(some_places(owner, 3)[1])[:16]
        inside = some_places(holder, 3)[1]
        packet = StoreCopies(owner.member, (item_of(object_record(name), inside),))
        assert (await holder.asked(packet, owner.node)).reasons == (0,)
        assert holder.places(OBJECTS) == {wanted_place(name)}
        assert await holder.store.parted(arc_of(holder)) == 0

    play(story)


def test_what_is_of_a_scene_that_is_unknown_is_refused_and_never_lost() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spot, another = some_places(owner, 2)
        assert await send(owner, holder, record_at(spot)) == (0,)
        scenes, holder.scenes = holder.scenes, {}
        assert await send(owner, holder, record_at(another)) == (RejectReason.UNKNOWN_SCENE_OR_SPACE,)
        holder.scenes = scenes
        assert await send(owner, holder, record_at(another)) == (0,)
        assert holder.places() == {spot, another}

    play(story)


def test_a_full_disk_says_so() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        terrace.net.machine(holder.address).disk.fill(0)
        assert await send(owner, holder, record_at(some_places(owner, 1)[0])) == (RejectReason.STORAGE_FULL,)

    play(story)


def test_an_answer_is_no_promise_if_custody_ended_while_the_record_was_written() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spot = some_places(owner, 1)[0]
        hold, keeper = holder.store.hold, holder.living.parts.keeper

        async def slow(puts: list[Put]) -> object:
            results = await hold(puts)
            await keeper.change_copies(lambda copies, _: replace(copies, custody=Custody()))
            return results

        holder.store.hold = slow
        assert await send(owner, holder, record_at(spot)) == (NOT_MINE,)

    play(story)


def test_all_that_lies_there_is_listed_in_pages_and_nothing_is_taken_behind_the_promise() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        arc = arc_of(owner)
        fixed = some_places(owner, 5)
        name = bytes(fixed[2])[:16]
        assert await send(owner, holder, *map(record_at, fixed), object_record(name)) == (0,) * 6
        strays = [record_at(place, space=SPACE) for place in fixed[:2]]
        await holder.store.merge([Put(record) for record in (*strays, record_at(some_places(holder, 1)[0]))])
        found = await pages(owner, holder, arc, limit=3)
        assert [page.reason for page in found] == [0] * len(found)
        assert [len(page.records) for page in found[:-1]] == [3] * (len(found) - 1)
        records = [(held.space, held.location, held.object, held.version.seq) for page in found for held in page.records]
        expected = [(SPACE, place, b"", 1) for place in fixed[:2]]
        expected += [(record_at(place).header.space, place, b"", 1) for place in fixed]
        assert records == [*expected, (OBJECTS, wanted_place(name), name, 1)]
        assert [[(told.first, told.last, told.number, told.whole) for told in page.entries] for page in found] == [
            [(arc.first, arc.last, 5, True)],
            *([] for _ in found[1:]),
        ]
        bound = first_number(terrace.log.registry.position)
        assert holder.durable_copies().custody.highest(arc) == bound - 1
        assert await send(owner, holder, record_at(fixed[0], 2)) == (NOT_MINE,), "not by the entry of before"
        members = owner.member, holder.member
        assert (await tell(owner, holder, bound - 1, entry(bound - 1, arc, members))).reason == BEHIND
        assert (await tell(owner, holder, bound, entry(bound, arc, members))).reason == 0
        assert await send(owner, holder, record_at(fixed[0], 2)) == (0,)

    play(story)


def test_who_asks_what_is_held_owns_the_place_and_is_not_ahead_of_the_log() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = await entrust(terrace)
        arc, before = arc_of(owner), holder.copies
        request = listing(owner, holder, arc)
        for packet, sender, reason in (
            (request, other.node, RejectReason.NOT_AUTHORISED),
            (replace(request, asker=other.member), other.node, NOT_READY),
            (replace(request, holder=other.member), owner.node, WRONG),
            (replace(request, log_position=request.log_position + 1), owner.node, BEHIND),
            (replace(request, log_position=0), owner.node, ILL),
            (listing(owner, holder, arc_of(holder)), owner.node, NOT_READY),
        ):
            answer = await holder.asked(packet, sender)
            assert (answer.reason, answer.records, answer.entries, answer.next) == (reason, (), (), None)
        assert holder.copies == before

    play(story)


def test_a_record_whose_header_has_rotted_is_in_no_list_and_hides_no_other() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 4)
        assert await send(owner, holder, *map(record_at, spots)) == (0,) * 4
        rot(holder, [spots[1]], 10)
        found = await pages(owner, holder, arc_of(owner), limit=1)
        assert [held.location for page in found for held in page.records] == [spots[0], *spots[2:]]

    play(story)


def test_a_gap_with_more_entries_than_a_page_holds_is_told_page_by_page() -> None:
    """An arc of two dead owners may have fallen into more pieces than one of them can name."""

    async def story(terrace: Terrace) -> None:
        owner, holder, *_ = terrace.homes
        first = arc_of(owner).first.number
        members = (owner.member, holder.member)
        pieces = [Arc(Location.from_number(first + 2 * index), Location.from_number(first + 2 * index)) for index in range(2_500)]
        custody = Custody(tuple(Entry(THIRDS, piece, 5, members, 1, whole=True) for piece in pieces))
        await holder.living.parts.keeper.change_copies(lambda copies, _: replace(copies, custody=custody))
        await holder.store.merge([Put(record_at(pieces[0].first)), Put(record_at(pieces[-1].first))])
        found = await pages(owner, holder, arc_of(owner), limit=1)
        assert [len(page.entries) for page in found] == [1_024, 1_024, 452, 0, 0]
        assert [entry.first for page in found for entry in page.entries] == [piece.first for piece in pieces]
        assert [held.location for page in found for held in page.records] == [pieces[0].first, pieces[-1].first]
        cursors = [page.next for page in found[:-1]]
        assert cursors == sorted(cursors, key=lambda cursor: cursor or b"")
        walk = Walk(holder.member, arc_of(owner), first_number(9))
        for page in found:
            walk.check(page)
            walk.move_on(page)
        assert (walk.is_over, len(walk.entries)) == (True, 2_500)

    play(story)
