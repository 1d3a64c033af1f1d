"""If one fails, a record that nobody has sound any more holds up all others, looks as if it had never been, or costs one that is sound."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import DamagedData
from scenefold.base.location import Location
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, wanted_place
from scenefold.peer.line.ends import Side
from scenefold.peer.replication import healing
from scenefold.store import Put
from scenefold.wire import FetchHeld, HandRecords, RecordEntry, StoreCopies
from unit.peer.line.street import places, rot
from unit.peer.replication.heirs import Estate, inherit, spread
from unit.peer.replication.heirs import until as until_heard
from unit.peer.replication.holders import entrust
from unit.peer.replication.terrace import OBJECTS, SPACE, Home, Terrace, item_of, object_record, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, lies_with_all, played
from unit.peer.replication.test_healing import HEADER_BYTE, LAST_BYTE, filled, until_sound
from unit.peer.replication.test_placing import until

SAID = pytest.mark.expect_log("damaged|rotten|changed|lost|does not deliver|connection was cut|had no owner any more|was reset")


async def seq_at(home: Home, place: Location) -> int | DamagedData | None:
    (found,) = await home.store.read([home.spot(place)])
    return found.header.seq if isinstance(found, Record) else found


async def lost(owner: Home, holders: list[Home], place: Location) -> None:
    """Its bytes are nowhere any more, and the owner knows."""
    (record,) = await owner.store.get_many([owner.spot(place).place])
    assert record is not None
    for home in holders:
        await home.store.remove([(home.spot(place), record.header.digest)])
    rot(owner, [place], LAST_BYTE)
    await owner.store.read([owner.spot(place)])


def forbid(owner: Home, home: Home) -> None:
    assert owner.own is not None
    owner.own.blacklist = Blacklist(1, (AddressPrefix(home.node, ADDRESS_BITS),))


@SAID
def test_what_nobody_has_sound_holds_up_no_other_record_and_is_told_as_damaged() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 6)
        former, other = holders_of(terrace, first, spots[2])
        (spare,) = [home for home in terrace.homes if home not in (first, former, other)]
        await lost(first, [former, other], spots[2])
        forbid(first, former)
        await until(lambda: spare in holders_of(terrace, first, spots[2]) and is_settled(first))
        assert lies_with_all(terrace, first, [place for place in spots if place != spots[2]])
        for home in (first, spare):
            assert isinstance(await seq_at(home, spots[2]), DamagedData)
        assert [await seq_at(spare, place) for place in spots if place != spots[2]] == [1] * 5
        document = await first.replication.health.document()
        assert document["rotten"]["waiting"] + document["rotten"]["unhealed"] == 1
        await first.replication.spreading.put([Put(record_at(spots[2]))], first.scenes)
        for home in (first, spare, other):
            await until_sound(home, spots[2])

    played(main, seed=21)


@SAID
def test_who_is_to_hold_what_has_rotted_past_knowing_gets_it_before_it_counts() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        former, other = holders_of(terrace, first, place)
        (spare,) = [home for home in terrace.homes if home not in (first, former, other)]
        # Nobody has read it since: it is in no sum, and in no list.
        rot(first, [place], HEADER_BYTE)
        forbid(first, former)
        await until(lambda: spare in holders_of(terrace, first, place) and is_settled(first))
        assert await seq_at(spare, place) == 1
        await until_sound(first, place)

    played(main, seed=27)


@SAID
def test_something_older_that_is_sound_stays_and_holds_up_nobody_either() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 3, seq=2)
        former, other = holders_of(terrace, first, spots[1])
        (spare,) = [home for home in terrace.homes if home not in (first, former, other)]
        await lost(first, [former, other], spots[1])
        forbid(first, former)
        await spare.store.merge([Put(record_at(spots[1], seq=1))])
        await until(lambda: spare in holders_of(terrace, first, spots[1]) and is_settled(first))
        assert await seq_at(spare, spots[1]) == 1
        assert isinstance(await seq_at(first, spots[1]), DamagedData)

    played(main, seed=22)


@SAID
def test_what_is_owed_and_nobody_has_is_owed_no_longer() -> None:
    """One holder has something older where it is owed, and nothing where it is owed something else."""

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 6)
        late, other = holders_of(terrace, first, spots[0])
        older, nothing = [place for place in spots if holders_of(terrace, first, place) == [late, other]][:2]
        (record,) = await late.store.get_many([late.spot(nothing).place])
        assert record is not None
        await late.store.remove([(late.spot(nothing), record.header.digest)])
        await first.store.put([Put(record_at(place, seq=2)) for place in (older, nothing)], [[late.node]] * 2)
        for place in (older, nothing):
            await lost(first, [], place)
        first.replication.spreading._judging.owes(late.node)
        await until(lambda: not any(first.store.owed.values()), 120.0)
        assert await seq_at(late, older) == 1
        assert isinstance(await seq_at(late, nothing), DamagedData)
        await first.replication.spreading.put([Put(record_at(place, seq=2)) for place in (older, nothing)], first.scenes)
        for home in (first, late, other):
            await until_sound(home, older, seq=2)
            await until_sound(home, nothing, seq=2)

    played(main, seed=26)


@SAID
def test_what_is_owed_of_a_wreck_and_nobody_has_is_owed_no_longer_and_nothing_older_takes_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(healing, "AGAIN_S", 30.0)

    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        late, other = holders_of(terrace, first, place)
        await first.store.put([Put(record_at(place, seq=2))], [[late.node]])
        await other.store.merge([Put(record_at(place, seq=2))])
        for home in (first, other):
            rot(home, [place], HEADER_BYTE)
            await home.store.read([home.spot(place)])
        first.replication.spreading._judging.owes(late.node)
        await until(lambda: not any(first.store.owed.values()), 120.0)
        # It is asked for again, and still nobody is believed who lacked it.
        await trio.sleep(90.0)
        assert await seq_at(late, place) == 1
        assert isinstance(await seq_at(first, place), DamagedData)
        await first.replication.spreading.put([Put(record_at(place, seq=2))], first.scenes)
        for home in (first, late, other):
            await until_sound(home, place, seq=2)

    played(main, seed=27)


@SAID
def test_an_owner_learns_from_a_holder_that_there_was_something() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        (place,) = await filled(terrace, 1)
        one, other = holders_of(terrace, first, place)
        await lost(one, [first, other], place)
        first.replication.comparing.check_all()
        await until(lambda: place in first.places() and place in other.places())
        for home in (first, other):
            assert isinstance(await seq_at(home, place), DamagedData)
        assert not first.store.owed, "nobody can be given it"

    played(main, seed=23)


@SAID
def test_who_recovers_a_place_knows_that_something_was_there() -> None:
    """Of the first nobody has the bytes; of the second somebody has; of the third an older version is sound."""

    async def story(estate: Estate) -> None:
        arc = await estate.entrust(2, 3)
        gone, whole, older = (record.header.location for record in spread(arc, 3))
        thing = object_record(bytes([64]) * 16)
        await estate.homes[3].keep(*(record_at(place, 2) for place in (gone, whole, older)))
        await estate.homes[3].keep_objects(thing)
        rot(estate.homes[3], [gone, whole, older, wanted_place(bytes([64]) * 16)], LAST_BYTE)
        await estate.homes[4].keep(record_at(whole, 2), record_at(older, 1))
        await estate.bury(1)
        heir = await estate.adopted(arc)
        await until_heard(lambda: not heir.gaps)
        assert isinstance(await seq_at(heir, gone), DamagedData)
        assert (await seq_at(heir, whole), await seq_at(heir, older)) == (2, 1)
        (spot,) = heir.spots(OBJECTS)
        assert isinstance((await heir.store.read([spot]))[0], DamagedData)

    inherit(story)


@SAID
def test_a_piece_takes_along_what_is_left() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        giver, receiver = terrace.homes[:2]
        await until(lambda: all(map(is_settled, terrace.homes)))
        gone, whole = places(arc_of(giver), 4)[2:]
        await giver.store.put([Put(record_at(place, space=SPACE)) for place in (gone, whole)])
        rot(giver, [gone], LAST_BYTE)
        piece = replace(arc_of(giver), first=gone)
        await until(lambda: not giver.living.parts.settling.settles_in_s(piece))
        await giver.living.give(Side.RIGHT, piece, why="a test")
        found = await receiver.store.read([receiver.spot(place, SPACE) for place in (gone, whole)])
        assert isinstance(found[0], DamagedData)
        assert found[1] == record_at(whole, space=SPACE)

    played(main, seed=24)


@SAID
def test_only_what_its_writer_signed_is_taken_and_only_where_it_can_mean_something() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        owner, holder = terrace.homes[:2]
        await entrust(terrace)
        record = record_at(places(arc_of(owner), 1)[0])
        husk = replace(item_of(record), ciphertext=b"")
        forged = replace(husk, signature=bytes(len(record.signature)))
        reply = await holder.asked(StoreCopies(owner.member, (forged, husk)), owner.node)
        assert reply.reasons == (int(RejectReason.SIGNATURE_INVALID), 0)
        header = record.header
        entry = RecordEntry(header.scene, header.space, header.location, b"", header.digest)
        assert (await holder.asked(FetchHeld((entry,)), owner.node)).items == (husk,)
        (outcome,) = (await owner.asked(HandRecords((husk,)), holder.node)).outcomes
        assert outcome.reason == RejectReason.ILL_FORMED

    played(main, is_quiet=True, homes=3, seed=25)


@SAID
def test_a_holder_that_has_a_wreck_keeps_what_the_owner_knows_of_it() -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        owner, holder = terrace.homes[:2]
        await entrust(terrace)
        record = record_at(places(arc_of(owner), 1)[0], seq=2)
        place = record.header.location
        await holder.store.merge([Put(record_at(place))])
        rot(holder, [place], HEADER_BYTE)
        assert await holder.store.record_headers([holder.spot(place)]) == [None]
        husk = replace(item_of(record), ciphertext=b"")
        assert (await holder.asked(StoreCopies(owner.member, (husk,)), owner.node)).reasons == (0,)
        assert await holder.store.record_headers([holder.spot(place)]) == [record.header_bytes]
        assert isinstance(await seq_at(holder, place), DamagedData)
        assert (await holder.asked(StoreCopies(owner.member, (item_of(record),)), owner.node)).reasons == (0,)
        assert await seq_at(holder, place) == 2

    played(main, is_quiet=True, homes=3, seed=26)
