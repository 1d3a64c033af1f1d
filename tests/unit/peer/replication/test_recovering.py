"""If one fails, what was acknowledged is not found by who adopts a gap, or it speaks before it knows (specs/20-copies.md, Recovery)."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import replace

import pytest
import trio

from scenefold.base.cover import without
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.line.ends import Side
from scenefold.peer.records.verification import KnownScene
from scenefold.wire import FetchHeld, HeldFetched, ListHeld, Packet, ReturnRange
from scenefold.world.sim import Point
from unit.peer.line.street import places, rot
from unit.peer.replication.heirs import Estate, Lies, held_of, inherit, places_of, spread, until
from unit.peer.replication.holders import arc_of
from unit.peer.replication.terrace import HEADER, OBJECTS, THRICE, Home, item_of, object_record, record_at
from unit.peer.scenes_made import SPACE, later_header, sealed

pytestmark = pytest.mark.usefixtures("only_errors")


def test_all_that_was_acknowledged_is_found_at_who_adopts() -> None:
    """Each record lies at the owner and at one holder, so that it is acknowledged; then the owner is gone."""

    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        records = spread(arc, 60)
        await estate.homes[2].keep(*records[::2])
        await estate.homes[3].keep(*records[1::2])
        things = [object_record(bytes([64 + index]) * 16) for index in range(4)]
        await estate.homes[3].keep_objects(*things)
        await estate.bury(1)
        heir = await estate.adopted(arc)
        assert heir is estate.homes[2], "who is a holder itself"
        await until(lambda: not heir.gaps)
        assert heir.places() >= places_of(records)
        assert {spot.object for spot in heir.spots(OBJECTS)} == {bytes([64 + index]) * 16 for index in range(4)}
        assert await heir.read(records[1].header.location) == (1, True), "nothing of it has settled"
        (segment,) = heir.copies.configurations.segments
        assert [found.number for found in segment.configurations] == [5]
        assert set(dict(segment.confirmed)) == {estate.homes[3].member, segment.configurations[0].members[0]}

    inherit(story)


def test_the_newest_version_counts_whoever_has_it() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        (place,) = places_of(spread(arc, 1))
        for number, seq in ((2, 2), (3, 3), (4, 1)):
            await estate.homes[number].keep(record_at(place, seq))
        await estate.bury(1)
        heir = await estate.adopted(arc)
        await until(lambda: not heir.gaps)
        assert await heir.read(place) == (3, True)

    inherit(story)


def test_two_of_five_are_gone_and_a_stray_is_as_good_as_a_copy() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        records = spread(arc, 40)
        await estate.homes[3].keep(*records[:30])
        await estate.homes[0].keep(*records[30:])
        await estate.bury(1, 2)
        heir = await estate.adopted(arc)
        await until(lambda: not heir.gaps)
        assert heir.places() >= places_of(records)

    inherit(story)


def test_what_lies_on_its_own_disk_without_right_is_found() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        strays = spread(arc, 5, seq=2)
        heir = estate.homes[2]
        estate.owner.leased = False  # It takes no stray any more.
        await heir.keep(*strays)
        await estate.homes[3].keep(*spread(arc, 5))
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps)
        for record in strays:
            assert await heir.read(record.header.location) == (2, True)

    inherit(story)


def test_until_all_are_heard_nothing_is_called_absent_or_written() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(3, 4)
        known, unknown, empty = spread(arc, 3, space=SPACE)
        heir, away = estate.homes[2], estate.homes[4]
        await heir.keep(known)
        await away.keep(unknown, record_at(known.header.location, 2, SPACE))
        estate.net.cut(heir.address, away.address)
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await trio.sleep(20.0)
        assert heir.gaps == (arc,), "though all others have said what they have"
        assert await heir.read(known.header.location, SPACE) == (1, True)
        for record in (unknown, empty):
            with pytest.raises(Refused) as refused:
                await heir.read(record.header.location, SPACE)
            assert refused.value.reason is RejectReason.NOT_READY
        assert await heir.write(record_at(empty.header.location, 1, SPACE)) == RejectReason.NOT_READY
        listed = await heir.listed(arc_of(heir), SPACE)
        assert isinstance(listed, ReturnRange)
        assert (listed.first, listed.last, listed.stale) == (arc.first, arc.last, True), "the gap alone"
        rest = without(arc_of(heir), arc)[0]
        assert await heir.listed(rest, SPACE) == ReturnRange(HEADER.scene, SPACE, rest.first, rest.last, (), (), stale=False)
        assert not heir.living.settled(Arc(arc.first, arc.first))
        with pytest.raises(Refused, match="being asked for"):
            await heir.living.give(Side.LEFT, arc, why="a test")
        estate.net.mend(heir.address, away.address)
        await until(lambda: not heir.gaps, 20.0)
        assert await heir.read(known.header.location, SPACE) == (2, False)
        assert await heir.read(unknown.header.location, SPACE) == (1, False)
        assert await heir.read(empty.header.location, SPACE) == (None, False)
        assert await heir.write(record_at(empty.header.location, 1, SPACE)) == 0
        assert not getattr(await heir.listed(arc, SPACE), "stale", True)

    inherit(story)


def test_who_is_away_need_not_be_heard_once_it_is_removed_and_its_leases_are_over() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(3, 4)
        heir, away = estate.homes[2], estate.homes[4]
        estate.net.cut(heir.address, away.address)
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await trio.sleep(20.0)
        assert heir.gaps == (arc,)
        away_member = away.member
        estate.remove(4)
        away.stays_down = True
        away.crash()
        await trio.sleep(10.0)
        assert heir.gaps == (arc,), "somebody may still be answered by what it held"
        await until(lambda: not heir.gaps, 10.0)
        assert away_member not in {member for segment in heir.copies.configurations.segments for member in segment.holders(heir.member)}

    inherit(story)


def test_who_is_started_anew_in_the_middle_begins_again() -> None:
    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 4)
        records = spread(arc, 20)
        heir, away = estate.homes[2], estate.homes[4]
        await estate.homes[3].keep(*records[::2])
        await away.keep(*records[1::2])
        estate.net.cut(heir.address, away.address)
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: heir.places() >= places_of(records[::2]))
        heir.crash()
        await heir.up.wait()
        assert heir.gaps == (arc,)
        estate.net.mend(heir.address, away.address)
        await until(lambda: not heir.gaps)
        assert heir.places() >= places_of(records)

    inherit(story)


def test_what_was_acknowledged_where_a_piece_was_taken_back_is_found() -> None:
    """Its receiver had claimed it, had written to it, and is gone before its giver has heard of that."""

    async def story(estate: Estate) -> None:
        giver, receiver, other = estate.homes[2], estate.homes[1], estate.homes[3]
        arc = arc_of(giver)
        records = spread(arc, 8, space=SPACE)
        await giver.keep(*records)
        await trio.sleep(12.0)
        piece = Arc(arc.first, records[4].header.location)
        # The third commit is the claim: noted, copied, taken.
        estate.net.trap(receiver.address, Point.AFTER_COMMIT, 3, receiver.crash)
        receiver.stays_down = True
        with pytest.raises(Unreachable):
            await giver.living.give(Side.LEFT, piece, why="a test")
        assert receiver.durable().owns(piece.first)
        newer = [record_at(record.header.location, 2, SPACE) for record in records[:5]]
        await other.keep(*newer)
        assert not giver.living.owns(piece.first)
        estate.remove(1)
        await until(lambda: giver.durable().owns(piece.first))
        await until(lambda: not giver.gaps)
        assert [await giver.read(record.header.location, SPACE) for record in newer] == [(2, False)] * 5
        assert await giver.read(records[5].header.location, SPACE) == (1, False)

    inherit(story)


def test_places_are_looked_up_by_name_while_the_rest_is_on_its_way() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, other = estate.homes[2], estate.homes[3]
        first, *rest = [record_at(record.header.location, 1, SPACE, bytes(8000)) for record in spread(arc, 600)]
        last = rest.pop()
        await estate.bury(1)
        await other.keep(*rest, last)
        heir.living.parts.budget.bytes_per_s = 100_000.0
        assert await estate.adopted(arc) is heir
        await until(lambda: heir.places(SPACE))
        assert last.header.location not in heir.places(SPACE)
        assert await heir.read(last.header.location, SPACE) == (1, False)
        assert last.header.location in heir.places(SPACE)
        assert await heir.read(first.header.location, SPACE) == (None, False)
        assert await heir.write(record_at(rest[-1].header.location, 1, SPACE)) == RejectReason.STALE_VERSION
        assert await heir.write(record_at(rest[-2].header.location, 2, SPACE)) == 0
        assert heir.gaps == (arc,)
        heir.living.parts.budget.bytes_per_s = 1e9
        await until(lambda: not heir.gaps)
        assert await heir.read(rest[-2].header.location, SPACE) == (2, False)

    inherit(story)


def test_who_names_what_he_does_not_have_holds_nobody_up() -> None:
    """And what he hands out instead of it is not kept."""

    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, liar, honest = estate.homes[2], estate.homes[3], estate.homes[4]
        true, other = spread(arc, 2, space=SPACE)
        await honest.keep(true)
        forged = item_of(other)
        forged = replace(forged, ciphertext=forged.ciphertext[:-1] + b"\0")
        answers = Lies(liar)
        answers.names = [held_of(record_at(true.header.location, 9, SPACE)), held_of(other)]
        answers.hands = [forged]
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps)
        assert await heir.read(true.header.location, SPACE) == (1, False)
        assert await heir.read(other.header.location, SPACE) == (None, False)
        assert heir.living.events["named, not delivered"] == 2

    inherit(story)


def test_who_never_comes_to_an_end_is_heard_no_further() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, liar = estate.homes[2], estate.homes[3]
        answers = Lies(liar)
        answers.names = [held_of(record) for record in spread(arc, 3)]
        answers.follows = b"x"
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps, 200.0)
        assert heir.living.events["disbelieved"] == 1

    inherit(story)


def test_what_a_slow_node_has_is_asked_for_in_smaller_parts() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, slow = estate.homes[2], estate.homes[3]
        records = spread(arc, 40, space=SPACE)
        await slow.keep(*records)
        fetch, senders = slow.handlers._table[FetchHeld]

        async def fetched(packet: FetchHeld, peer: str) -> Packet:
            if len(packet.entries) > 4:
                await trio.sleep(60.0)
            answer: Packet = await fetch(packet, peer)
            return answer

        slow.handlers._table[FetchHeld] = fetched, senders
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps, 200.0)
        assert heir.places(SPACE) >= places_of(records)
        assert not heir.living.events["named, not delivered"]

    inherit(story)


def test_what_one_node_has_is_waited_for_however_long_others_had_their_turns() -> None:
    """Two bring nothing for half a minute each, while the third, whose first answer is too large to come in time, waits for its turn."""

    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, honest = estate.homes[2], estate.homes[3]
        records = spread(arc, 40, space=SPACE)
        await honest.keep(*records)
        for number in (0, 4):
            drags(estate.homes[number], spread(arc, 5, seq=9, space=SPACE))
        listed, senders = honest.handlers._table[ListHeld]
        fetch, _ = honest.handlers._table[FetchHeld]

        async def late(packet: ListHeld, peer: str) -> Packet:
            await trio.sleep(1.0)
            answer: Packet = await listed(packet, peer)
            return answer

        async def fetched(packet: FetchHeld, peer: str) -> Packet:
            if len(packet.entries) > 10:
                await trio.sleep(60.0)
            answer: Packet = await fetch(packet, peer)
            return answer

        honest.handlers._table[ListHeld] = late, senders
        honest.handlers._table[FetchHeld] = fetched, senders
        await estate.bury(1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps, 300.0)
        assert heir.places(SPACE) >= places_of(records), "they come home only later"

    inherit(story)


def drags(home: Home, records: Sequence[Record]) -> None:
    """It names these, and denies them one by one, each just before the answer is late."""
    lies = Lies(home)
    lies.names = [held_of(record) for record in records]
    _, senders = home.handlers._table[FetchHeld]

    async def denied(_packet: FetchHeld, _peer: str) -> Packet:
        await trio.sleep(9.0)
        return HeldFetched((), (0,))

    home.handlers._table[FetchHeld] = denied, senders


@pytest.mark.parametrize("forgotten", ["all of it", "the newest"])
def test_a_header_that_only_the_teller_has_is_had_from_the_teller(forgotten: str) -> None:
    """Who decides the scene was put back to a backup, or is gone: what was acknowledged since counts as held all the same."""

    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        later = later_header(HEADER)
        records = [sealed(later, location=place, space=THRICE, nonce=place.number.to_bytes(20, "big")[:12]) for place in places(arc, 3)]
        for number, home in enumerate(estate.homes):
            if number == 3:
                home.scenes[HEADER.scene] = KnownScene.of(later)
            elif forgotten == "all of it":
                home.scenes.clear()
        await estate.homes[3].keep(*records)
        await estate.bury(1)
        heir = await estate.adopted(arc)
        assert heir is estate.homes[2]
        await until(lambda: not heir.gaps)
        assert heir.places() >= places_of(records)
        assert not heir.living.events["named, not delivered"]

    inherit(story)


@pytest.mark.expect_log("have changed on the disk")
def test_what_one_cannot_deliver_any_more_comes_from_the_next() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir = estate.homes[2]
        records = spread(arc, 4, space=SPACE)
        await estate.bury(1)
        for number in (3, 4):
            await estate.homes[number].keep(*records)
        rot(estate.homes[3], places_of(records), -1)
        assert await estate.adopted(arc) is heir
        await until(lambda: not heir.gaps)
        assert heir.places(SPACE) >= places_of(records)
        assert [await heir.read(record.header.location, SPACE) for record in records] == [(1, False)] * 4

    inherit(story)


@pytest.mark.parametrize("seed", range(6))
def test_whatever_crashes_while_it_is_asked_for(seed: int) -> None:
    """Versions lie anywhere; heir and tellers crash in the midst of commits, and links are cut for a while."""

    async def story(estate: Estate) -> None:
        dice = random.Random(seed)
        arc = await estate.entrust(2, 3)
        where = [record.header.location for record in spread(arc, 40)]
        best = dict.fromkeys(where, 0)
        await estate.bury(1)
        tellers = [0, 2, 3, 4]
        for place in where:
            for number in dice.sample(tellers, dice.randint(0, 3)):
                seq = dice.randint(1, 5)
                best[place] = max(best[place], seq)
                await estate.homes[number].keep(record_at(place, seq, SPACE))
        heir = estate.homes[2]
        await until(lambda: heir.durable().owns(arc.first))
        for number in dice.sample(tellers, 2):
            home = estate.homes[number]
            estate.net.trap(home.address, dice.choice([Point.BEFORE_COMMIT, Point.AFTER_COMMIT]), dice.randint(1, 3), home.crash)
        away = estate.homes[dice.choice([0, 3, 4])]
        estate.net.cut(heir.address, away.address)
        await trio.sleep(dice.uniform(0.0, 5.0))
        estate.net.mend(heir.address, away.address)
        await until(lambda: not heir.gaps)
        await heir.up.wait()
        for place, seq in best.items():
            assert await heir.read(place, SPACE) == (seq or None, False)

    inherit(story, seed=seed)


def test_two_gaps_are_asked_for_beside_each_other() -> None:
    """The second one comes while the first still waits for somebody, and is another one's to adopt or joined to it."""

    async def story(estate: Estate) -> None:
        heir, away = estate.homes[3], estate.homes[4]
        first, second = arc_of(estate.homes[2]), arc_of(estate.homes[1])
        records = [*spread(first, 5, space=SPACE), *spread(second, 5, space=SPACE)]
        estate.net.cut(heir.address, away.address)
        await estate.bury(2)
        await estate.homes[0].keep(*records[:5:2])
        await away.keep(*records[1:5:2])
        assert await estate.adopted(first) is heir
        assert heir.gaps == (first,)
        await estate.bury(1)
        await estate.homes[0].keep(*records[6::2])
        await away.keep(*records[5::2])
        assert await estate.adopted(second) is heir
        assert heir.gaps == (Arc(second.first, first.last),)
        await until(lambda: heir.places(SPACE) >= places_of(records[:5:2] + records[6::2]))
        estate.net.mend(heir.address, away.address)
        await until(lambda: not heir.gaps)
        assert [await heir.read(record.header.location, SPACE) for record in records] == [(1, False)] * 10

    inherit(story)


def test_what_is_found_by_name_where_there_are_copies_is_not_told_as_settled() -> None:
    """Nor is anything written: whom that would need is not known yet. That nothing is there may be said."""

    async def story(estate: Estate) -> None:
        arc = await estate.entrust(3, 4)
        heir, other = estate.homes[2], estate.homes[3]
        heavy = [record_at(record.header.location, 1, SPACE, bytes(8000)) for record in spread(arc, 400)]
        there, absent = (record_at(place) for place in list(places_of(spread(arc, 1000)))[-2:])
        await estate.bury(1)
        await other.keep(*heavy, there)
        heir.living.parts.budget.bytes_per_s = 100_000.0
        assert await estate.adopted(arc) is heir
        await until(lambda: heir.places(SPACE))
        assert await heir.read(there.header.location) == (1, True)
        assert await heir.read(absent.header.location) == (None, False)
        assert await heir.write(record_at(absent.header.location)) == RejectReason.NOT_READY
        assert heir.gaps == (arc,)
        assert absent.header.location not in heir.places()

    inherit(story)


def test_a_full_disk_puts_it_off() -> None:
    async def story(estate: Estate) -> None:
        arc = arc_of(estate.owner)
        heir, other = estate.homes[2], estate.homes[3]
        records = [record_at(record.header.location, 1, SPACE, bytes(8000)) for record in spread(arc, 20)]
        await estate.bury(1)
        await other.keep(*records)
        estate.net.cut(heir.address, other.address)
        assert await estate.adopted(arc) is heir
        disk = estate.net.machine(heir.address).disk
        disk.fill()
        estate.net.mend(heir.address, other.address)
        await trio.sleep(20.0)
        assert heir.gaps == (arc,)
        assert not heir.places(SPACE)
        disk.fill(None)
        await until(lambda: not heir.gaps)
        assert heir.places(SPACE) >= places_of(records)

    inherit(story)
