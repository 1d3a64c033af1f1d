"""If one fails, a copy is deleted as if it were a stray, or a stray stays for ever as if it were a copy."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, wanted_place
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.versions import told_version
from scenefold.peer.line import Side
from scenefold.peer.line.strays import BUSY_S_MAX, LEFT_S
from scenefold.peer.line.unsettled import Doubt
from scenefold.store import Put
from scenefold.wire import HandRecords, HeldRecord, OfferStrays
from scenefold.world.sim import Point, run_simulated
from unit.peer.line.street import places, rot
from unit.peer.replication.holders import GHOST, arc_of, count_on, entrust, entry, play, send, settle_in, some_places, tell
from unit.peer.replication.terrace import HEADER, OBJECTS, SPACE, THIRDS, Terrace, object_record, record_at

MISSED, BUSY = RejectReason.PEER_MISSED, RejectReason.BUSY
LONG_S = LEFT_S + 70.0
"""Strays are looked for after a minute at the latest; for some time after a start those of spaces with copies are let alone."""


def held_of(record: Record) -> HeldRecord:
    header = record.header
    return HeldRecord(header.scene, header.space, header.location, b"", told_version(record.header_bytes))


def settled(story: Callable[[Terrace], Awaitable[None]], seconds: float = 500.0) -> None:
    """Tell a story on a terrace whose owners know who holds copies."""

    async def whole(terrace: Terrace) -> None:
        await settle_in(terrace)
        await story(terrace)

    play(whole, seconds=seconds)


def test_copies_in_custody_stay_and_all_else_comes_home() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 4)
        name = bytes(spots[3])[:16]
        assert await send(owner, holder, *map(record_at, spots), object_record(name)) == (0,) * 5
        await holder.store.merge([Put(record_at(place, space=SPACE)) for place in spots])
        foreign = some_places(terrace.homes[2], 3)
        await holder.store.merge([Put(record_at(place)) for place in foreign])
        await trio.sleep(LONG_S)
        assert holder.places() == set(spots)
        assert len(terrace.homes[1].stored()) == 5, "and the object"
        assert owner.places(SPACE) == set(spots)
        assert terrace.homes[2].places() == set(foreign)
        assert (await holder.living.remaining()).strays == 0

    settled(story)


def test_what_is_held_no_more_comes_home() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 4)
        assert await send(owner, holder, *map(record_at, spots)) == (0,) * 4
        await trio.sleep(LONG_S)
        assert (await tell(owner, holder, 6)).reason == 0
        await trio.sleep(3.0)
        assert (holder.places(), owner.places()) == (set(), set(spots)), "at once"

    settled(story)


def test_of_a_space_that_is_unknown_nothing_is_given_up_where_anything_is_held() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 4)
        assert await send(owner, holder, *map(record_at, spots)) == (0,) * 4
        holder.scenes = {}
        await trio.sleep(LONG_S)
        assert holder.places() == set(spots)

    settled(story)


def test_who_does_not_know_yet_that_it_holds_a_place_deletes_nothing_there() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = terrace.homes
        spots = some_places(owner, 4)
        await holder.store.merge([Put(record_at(place)) for place in spots])
        await count_on(owner, (owner.member, holder.member, other.member))
        await trio.sleep(LONG_S)
        assert holder.places() == set(spots)
        await count_on(owner, (owner.member, other.member))
        await trio.sleep(2 * BUSY_S_MAX)
        assert (holder.places(), owner.places()) == (set(), set(spots)), "it asks again soon"

    settled(story)


def test_who_is_told_to_hold_what_it_was_about_to_delete_keeps_it() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = terrace.homes
        spots = some_places(owner, 4)
        ask = holder.peers.ask

        async def late(*details: Any) -> Any:
            reply = await ask(*details)
            if not holder.copies.custody.entries:
                await entrust(terrace)
            return reply

        holder.peers.ask = late  # type: ignore[method-assign]
        await holder.store.merge([Put(record_at(place)) for place in spots])
        await trio.sleep(LONG_S)
        assert owner.places() == set(spots), "it was asked"
        assert holder.places() == set(spots)

    settled(story)


def test_a_giver_keeps_what_has_copies_until_it_is_told_what_it_holds() -> None:
    async def story(terrace: Terrace) -> None:
        giver, receiver, _ = terrace.homes
        spots = some_places(giver, 8)
        for space in (terrace.space, SPACE):
            await giver.store.put([Put(record_at(place, space=space)) for place in spots])
        middle, last = spots[4], arc_of(giver).last
        await trio.sleep(LONG_S)
        piece = Arc(middle, last)
        await giver.living.give(Side.RIGHT, piece, why="a test")
        await trio.sleep(LEFT_S / 2)
        assert not giver.living.open_handovers()
        assert giver.places(SPACE) == set(spots[:4])
        assert giver.places() == set(spots), "all of it"
        members = receiver.member, giver.member
        assert (await tell(receiver, giver, 9, entry(9, Arc(middle, spots[5]), members), scope=piece)).reason == 0
        held = {place for place in spots[4:] if place <= spots[5]}
        await count_on(receiver, (receiver.member, GHOST))
        await trio.sleep(LONG_S)
        assert giver.places() == {*spots[:4], *held}
        assert receiver.places() >= set(spots[4:])

    settled(story, seconds=1000.0)


def test_what_its_owner_has_is_not_sent() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = terrace.homes
        spots = some_places(owner, 6)
        await owner.store.put([Put(record_at(place, seq=2)) for place in spots[:2]])
        strays = [record_at(place, seq=seq) for place, seq in zip(spots, (1, 2, 1, 1, 1, 1), strict=True)]
        await holder.store.merge([Put(record) for record in strays])
        await holder.store.merge([Put(record_at(place, space=SPACE)) for place in spots[:2]])
        ask, brought = holder.peers.ask, []

        async def noted(*details: Any) -> Any:
            if isinstance(details[2], HandRecords):
                brought.extend((item.space, item.location) for item in details[2].items)
            return await ask(*details)

        holder.peers.ask = noted  # type: ignore[method-assign]
        await trio.sleep(LONG_S)
        assert holder.stored() == set()
        assert owner.places() == set(spots)
        assert sorted(brought) == [*((SPACE, place) for place in spots[:2]), *((terrace.space, place) for place in spots[2:])]

    settled(story)


@pytest.mark.expect_log("damaged|changed")
def test_an_owner_says_of_each_stray_what_is_to_become_of_it() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = terrace.homes
        spots = some_places(owner, 6)
        await owner.store.put([Put(record_at(place)) for place in spots[:4]])
        await owner.living.parts.keeper.change_copies(lambda copies, _: replace(copies, configurations=Configurations(owner.member)))
        whatever = OfferStrays((held_of(record_at(spots[0])),))
        assert (await owner.asked(whatever, holder.node)).reasons == (BUSY,), "who holds copies of it is not known yet"
        await count_on(owner, (owner.member, other.member))
        rot(owner, [spots[1]], -1)
        unsettled = owner.living.parts.unsettled
        doubted = Arc(spots[2], spots[2])
        unsettled.doubts = (Doubt(THIRDS, doubted, 2),)
        newer = record_at(spots[3], seq=2)
        told = [*map(record_at, spots[:3]), newer, record_at(spots[4])]
        packet = OfferStrays(tuple(map(held_of, told)))
        judged = await owner.asked(packet, holder.node)
        assert judged.reasons == (0, MISSED, BUSY, MISSED, MISSED)
        owner.leased = False
        assert set((await owner.asked(packet, holder.node)).reasons) == {BUSY}
        owner.leased = True
        assert set((await other.asked(packet, holder.node)).reasons) == {BUSY}, "it owns nothing of it"
        await count_on(owner, (owner.member, holder.member, other.member))
        assert set((await owner.asked(packet, holder.node)).reasons) == {BUSY}, "these are copies"

    settled(story)


def test_a_stray_stays_while_fewer_have_its_record_than_its_space_asks_for() -> None:
    """Though it was acknowledged once: since then a holder may have gone."""

    async def story(terrace: Terrace) -> None:
        owner, holder, _ = terrace.homes
        had, brought = some_places(owner, 2)
        for members, is_deleted in (((owner.member,), False), ((owner.member, GHOST), True)):
            await count_on(owner, members, 1)
            await owner.store.put([Put(record_at(had))])
            await holder.store.merge([Put(record_at(place)) for place in (had, brought)])
            await trio.sleep(LONG_S)
            assert owner.places() == {had, brought}
            assert holder.places() == (set() if is_deleted else {had, brought})

    settled(story)


def test_an_object_that_a_giver_keeps_beside_its_home_slides_there_when_its_place_is_the_nodes_own() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        name = bytes(some_places(owner, 3)[1])[:16]
        beside = some_places(holder, 4)[3]
        await holder.store.merge([Put(object_record(name), at=beside)])
        arc = arc_of(holder)
        await trio.sleep(LONG_S)
        await holder.living.give(Side.RIGHT, Arc(Location.from_number(beside.number - 1), arc.last), why="a test")
        assert [spot.place.location for spot in holder.spots(OBJECTS)] == [wanted_place(name)]
        assert (await holder.store.range(HEADER.scene, OBJECTS, arc, 9)).locations == []

    settled(story, seconds=1000.0)


def test_an_object_beside_its_home_blocks_no_handover() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        name = bytes(some_places(owner, 3)[1])[:16]
        arc = arc_of(holder)
        beside = some_places(holder, 4)[3]
        await trio.sleep(20.0)
        store, slide = holder.store, holder.store.slide

        async def nowhere(parts: Any, limit: int = 1) -> int:
            return 0

        store.slide = nowhere
        await store.merge([Put(object_record(name), at=beside)])
        await holder.living.give(Side.RIGHT, Arc(Location.from_number(beside.number - 1), arc.last), why="a test")
        store.slide = slide
        await trio.sleep(LONG_S)
        assert len(holder.spots(OBJECTS)) == 1, "it is a copy"

    settled(story, seconds=1000.0)


def test_a_stray_is_deleted_once_all_that_its_space_asks_for_have_it() -> None:
    """With everything that goes on by itself."""

    async def main() -> None:
        terrace = Terrace(5)
        async with trio.open_nursery() as nursery:
            await terrace.begin(nursery)
            owner = terrace.homes[0]
            await trio.sleep(30.0)
            segment = owner.copies.configurations.at(THIRDS, arc_of(owner).first)
            assert segment is not None
            spots = places(segment.arc, 4)
            holders = {member.node for member in segment.holders(owner.member)}
            bringer = next(home for home in terrace.homes[1:] if home.node not in holders)
            await bringer.store.merge([Put(record_at(place)) for place in spots])
            had: list[int] = []

            def look() -> None:
                if len(bringer.places()) < len(spots):
                    had.append(min(sum(place in home.places() for home in terrace.homes) for place in spots))

            terrace.net.observe(bringer.address, Point.AFTER_COMMIT, look)
            await trio.sleep(LONG_S)
            assert bringer.places() == set()
            assert owner.places() == set(spots)
            assert had and min(had) >= 2, "never on fewer disks than are needed"
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=120.0)
