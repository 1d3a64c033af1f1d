"""If one fails, who compares or reads at a holder believes that something is there, or is not, that nobody may say."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, wanted_place
from scenefold.peer.copies.versions import told_version
from scenefold.peer.replication import holding_reads, holding_records
from scenefold.store import Put, version_of
from scenefold.wire import (
    CompareRange,
    Configuration,
    CopiesFound,
    Copy,
    CopyState,
    FetchHeld,
    GetCopies,
    HeldFetched,
    RangeCompared,
    RecordBytes,
    RecordEntry,
    RecordKey,
    Span,
)
from unit.peer.line.street import rot
from unit.peer.replication.holders import arc_of, ask, entrust, entry, play, send, some_places, tell
from unit.peer.replication.terrace import HEADER, OBJECTS, THRICE, Home, Terrace, item_of, object_record, record_at
from unit.peer.scenes_made import SPACE

UNKNOWN = NodeId(1)
IN_BODY, IN_HEADER = -1, 10


def summed(*records: Record) -> bytes:
    """As the page says, and not as the code does."""
    total = sum(int.from_bytes(version_of(record.header_bytes)[:16], "big") for record in records) % (1 << 128)
    return bytes(16) + total.to_bytes(16, "big")


async def compared(owner: Home, holder: Home, *arcs: Arc, list_below: int = 256) -> tuple[Any, ...]:
    packet = CompareRange(HEADER.scene, THRICE, tuple(Span(arc.first, arc.last) for arc in arcs), list_below)
    found: RangeCompared = await ask(owner, holder, packet, RangeCompared)
    return found.sums


def entry_of(record: Record, location: Location | None = None) -> RecordEntry:
    item = item_of(record, location)
    return RecordEntry(item.scene, item.space, item.location, item.object, record.header.digest)


async def copies(holder: Home, *keys: RecordKey, digests_only: bool = False, any_copy: bool = False) -> CopiesFound:
    found: CopiesFound = await holder.asked(GetCopies(HEADER.scene, 1, keys, digests_only, any_copy))
    return found


def key(location: Location, space: SpaceId = THRICE, object_id: bytes = b"") -> RecordKey:
    return RecordKey(space, location, object_id)


def bytes_of(record: Record) -> RecordBytes:
    return RecordBytes(record.signature, record.header_bytes, record.ciphertext)


# ------------------------------------------------------------------------------------------------------------ comparing


def test_sums_and_lists_are_those_of_what_lies_there_by_homes() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 6)
        records = [record_at(place) for place in spots]
        assert await send(owner, holder, *records) == (0,) * 6
        whole = arc_of(owner)
        first, rest = Arc(whole.first, spots[1]), Arc(spots[2], whole.last)
        stray = some_places(holder, 2)[1]
        await holder.store.merge([Put(record_at(stray))])
        all_of_it, few, many, elsewhere = await compared(owner, holder, whole, first, rest, Arc(stray, stray), list_below=2)
        assert (all_of_it.count, all_of_it.sum, all_of_it.records, all_of_it.whole) == (6, summed(*records), None, True)
        assert (few.count, few.sum) == (2, summed(*records[:2]))
        listed = [(found.location, found.object, found.version) for found in few.records]
        assert listed == [(place, b"", told_version(record.header_bytes)) for place, record in zip(spots, records[:2], strict=False)]
        assert (many.count, many.sum, many.records) == (4, summed(*records[2:]), None)
        assert (elsewhere.count, elsewhere.sum, elsewhere.whole) == (1, summed(record_at(stray)), True), "its own place"
        assert (await compared(owner, holder, whole, list_below=0))[0].records is None
        assert (await compared(holder, owner, whole))[0].whole
        assert (await compared(owner, terrace.homes[2], arc_of(holder)))[0].whole is False

    play(story)


@pytest.mark.expect_log("its header has changed")
def test_a_copy_that_is_being_filled_is_not_whole_and_what_has_rotted_is_not_there() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace, whole=False)
        spots = some_places(owner, 3)
        records = [record_at(place) for place in spots]
        assert await send(owner, holder, *records) == (0,) * 3
        rot(holder, [spots[1]], IN_HEADER)
        (found,) = await compared(owner, holder, arc_of(owner))
        assert not found.whole
        assert [listed.location for listed in found.records] == [spots[0], spots[2]]
        assert found.sum == summed(records[0], records[2]), "as of its list, whatever a tree remembers"

    play(story)


def test_only_members_compare_and_fetch() -> None:
    async def story(terrace: Terrace) -> None:
        holder = terrace.homes[1]
        for packet in (CompareRange(HEADER.scene, THRICE, (), 0), FetchHeld(())):
            with pytest.raises(Refused, match="no member"):
                await holder.asked(packet, UNKNOWN)
            with pytest.raises(Refused, match="may not send"):
                await holder.asked(packet)
        assert (await holder.asked(FetchHeld(()), terrace.homes[0].node)).items == ()

    play(story)


@pytest.mark.expect_log("damaged|changed")
def test_exact_versions_are_fetched_and_the_others_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 4)
        name = bytes(spots[3])[:16]
        sound, rotten, newer = record_at(spots[0]), record_at(spots[1]), record_at(spots[2], 2)
        thing = object_record(name)
        assert await send(owner, holder, sound, rotten, newer, thing) == (0,) * 4
        rot(holder, [spots[1]], IN_BODY)
        wanted = [sound, rotten, record_at(spots[2], 1), record_at(spots[3]), newer, thing]
        packet = FetchHeld(tuple(map(entry_of, wanted)))
        found: HeldFetched = await ask(owner, holder, packet, HeldFetched)
        assert found.missing == (2, 3)
        husk = replace(item_of(rotten), ciphertext=b"")
        assert found.items == (item_of(sound), husk, item_of(newer), item_of(thing)), "what is left of what has rotted is told"
        monkeypatch.setattr(holding_records, "BULK_BYTES_MAX", 1)
        found = await ask(owner, holder, packet, HeldFetched)
        assert found.items == (item_of(sound),), "at least one, and as many as fit"
        monkeypatch.undo()

    play(story)


# --------------------------------------------------------------------------------------------------------------- reads


def test_a_whole_copy_answers_under_its_configuration() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, other = await entrust(terrace)
        there, absent = some_places(owner, 2)
        name = bytes(some_places(owner, 5)[3])[:16]
        record, thing = record_at(there), object_record(name)
        assert await send(owner, holder, record, thing) == (0, 0)
        keys = key(there), key(absent), key(wanted_place(name), OBJECTS, name), key(some_places(holder, 1)[0]), key(there, SPACE)
        found = await copies(holder, *keys)
        (group,) = found.holders
        assert (group.number, group.members, group.needed) == (5, (owner.member, holder.member, other.member), 2)
        assert found.copies == (
            Copy(CopyState.RECORD, 0, b"", bytes_of(record)),
            Copy(CopyState.NOTHING, 0, b"", None),
            Copy(CopyState.RECORD, 0, b"", bytes_of(thing)),
            Copy(CopyState.NO_CUSTODY, 0, b"", None),
            Copy(CopyState.NO_CUSTODY, 0, b"", None),
        )
        digests = await copies(holder, key(there), key(absent), digests_only=True)
        assert digests.copies == (
            Copy(CopyState.DIGEST, 0, version_of(record.header_bytes), None),
            Copy(CopyState.NOTHING, 0, b"", None),
        )
        with pytest.raises(Refused, match="holds the copies"):
            await copies(holder, key(there, SpaceId(THRICE + 1)))

    play(story)


def test_without_a_lease_or_a_whole_copy_only_who_takes_any_copy_is_answered() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, filled = await entrust(terrace)
        there, absent = some_places(owner, 2)
        record = record_at(there)
        members = owner.member, holder.member, filled.member
        assert (await tell(owner, filled, 6, entry(6, arc_of(owner), members, whole=False))).reason == 0
        for home in (holder, filled):
            assert await send(owner, home, record) == (0,)
        holder.leased = False
        for home in (holder, filled):
            found = await copies(home, key(there), key(absent))
            assert (found.holders, {copy.state for copy in found.copies}) == ((), {CopyState.NO_CUSTODY})
        any_of = await copies(holder, key(there), key(absent), any_copy=True)
        assert [copy.state for copy in any_of.copies] == [CopyState.RECORD, CopyState.NOTHING]
        part = await copies(filled, key(there), key(absent), any_copy=True)
        assert [copy.state for copy in part.copies] == [CopyState.RECORD, CopyState.NO_CUSTODY], "it cannot say what there is not"

    play(story)


def test_a_stray_is_shown_to_who_takes_any_copy_and_counts_for_nobody() -> None:
    async def story(terrace: Terrace) -> None:
        owner, bystander = terrace.homes[0], terrace.homes[1]
        there, absent = some_places(owner, 2)
        record = record_at(there)
        await bystander.store.merge([Put(record)])
        await owner.store.merge([Put(record)])
        for asked in ({}, {"digests_only": True}, {"digests_only": True, "any_copy": True}):
            found = await copies(bystander, key(there), key(absent), **asked)
            assert (found.holders, {copy.state for copy in found.copies}) == ((), {CopyState.NO_CUSTODY}), asked
        shown = await copies(bystander, key(there), key(absent), any_copy=True)
        assert shown.holders == (Configuration(0, (bystander.member,), 1),)
        assert shown.copies == (Copy(CopyState.RECORD, 0, b"", bytes_of(record)), Copy(CopyState.NO_CUSTODY, 0, b"", None))
        own = await copies(owner, key(there), any_copy=True)
        assert [copy.state for copy in own.copies] == [CopyState.NO_CUSTODY], "what it owns is no stray"

    play(story)


@pytest.mark.expect_log("damaged|changed")
def test_what_has_rotted_is_said_to_be_damaged() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        (spot,) = some_places(owner, 1)
        assert await send(owner, holder, record_at(spot)) == (0,)
        rot(holder, [spot], IN_BODY)
        assert [copy.state for copy in (await copies(holder, key(spot))).copies] == [CopyState.DAMAGED]
        assert [copy.state for copy in (await copies(holder, key(spot), digests_only=True)).copies] == [CopyState.DIGEST], "it was there"
        rot(holder, [spot], IN_HEADER)
        for digests_only in (False, True):
            found = await copies(holder, key(spot), digests_only=digests_only)
            assert [copy.state for copy in found.copies] == [CopyState.DAMAGED], "and never that nothing is there"

    play(story)


def test_an_entry_that_ended_while_the_records_were_read_answers_nothing() -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        (spot,) = some_places(owner, 1)
        assert await send(owner, holder, record_at(spot)) == (0,)
        read = holder.store.read

        async def slow(spots: Any) -> Any:
            found = await read(spots)
            assert (await tell(owner, holder, 6)).reason == 0
            return found

        holder.store.read = slow
        assert [copy.state for copy in (await copies(holder, key(spot))).copies] == [CopyState.NO_CUSTODY]

    play(story)


def test_as_many_as_fit_are_answered_and_at_least_one(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(terrace: Terrace) -> None:
        owner, holder, _ = await entrust(terrace)
        spots = some_places(owner, 3)
        assert await send(owner, holder, *map(record_at, spots)) == (0,) * 3
        monkeypatch.setattr(holding_reads, "BULK_BYTES_MAX", 1)
        assert len((await copies(holder, *map(key, spots))).copies) == 1
        monkeypatch.undo()
        assert len((await copies(holder, *map(key, spots))).copies) == 3

    play(story)


def test_a_scene_that_nobody_knows_is_unknown_to_readers_of_copies_too() -> None:
    async def story(terrace: Terrace) -> None:
        _, holder, _ = await entrust(terrace)
        holder.scenes = {}
        with pytest.raises(Refused) as refusal:
            await copies(holder, key(Location.from_number(1)))
        assert refusal.value.reason is RejectReason.UNKNOWN_SCENE_OR_SPACE

    play(story)
