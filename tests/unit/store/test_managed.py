"""If this failed, records of node-managed spaces would be stored twice, lost when they slide, or overwrite each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location
from scenefold.crypto import EXPECTS_NOTHING, RecordPlace, wanted_place
from scenefold.store import Outcome, Put, Rightful, Spot, Store
from unit.store.samples import SCENE, SPACE, arc, managed, object_id, put, whole_store, world


def spot(object_number: int, at: Location) -> Spot:
    return Spot(RecordPlace(SCENE, SPACE, at), object_id(object_number))


async def placed(store: Store, put: Put) -> Location:
    [result] = await store.put([put])
    assert result.outcome is Outcome.STORED
    assert result.location is not None
    return result.location


async def test_the_node_takes_the_place_that_the_id_names(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        assert await placed(store, Put(managed(1))) == wanted_place(object_id(1))
        assert await store.read([spot(1, wanted_place(object_id(1)))]) == [managed(1)]


async def test_it_takes_the_next_free_place_of_its_arc_if_that_is_taken(tmp_path: Path) -> None:
    home = wanted_place(object_id(1)).number
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(home), put(home + 1)])
        assert await placed(store, Put(managed(1))) == Location.from_number(home + 2)
        await store.put_holding(arc(home - 5, home + 1), b"")
        assert await placed(store, Put(managed(1, seq=2))) == Location.from_number(home - 5), "in its arc, going round"
        await store.put_holding(arc(home, home + 1), b"")
        shared = await placed(store, Put(managed(1, seq=3)))
        # No place is free: they share one, and are still told apart.
        assert await store.read([spot(1, shared), Spot(RecordPlace(SCENE, SPACE, Location.from_number(home)))]) == [
            managed(1, seq=3),
            put(home).record,
        ]
        assert (await store.statistics()).records == 3


async def test_only_the_owner_of_its_home_takes_an_object(tmp_path: Path) -> None:
    home = wanted_place(object_id(1)).number
    async with whole_store(world(), tmp_path) as store:
        first = await placed(store, Put(managed(1)))
        await store.put_holding(arc(home + 1, home + 10), b"")
        for copy in (managed(1), managed(1, seq=2)):
            [result] = await store.put([Put(copy)])
            assert (result.outcome, result.location) == (Outcome.NOT_OWNED, None)
        assert await store.read([spot(1, first)]) == [managed(1)]


async def test_its_header_is_found_wherever_it_lies(tmp_path: Path) -> None:
    home = wanted_place(object_id(1)).number
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(home)])
        there = await placed(store, Put(managed(1)))
        assert there != wanted_place(object_id(1))
        asked = [
            spot(1, wanted_place(object_id(1))),
            spot(1, there),
            Spot(RecordPlace(SCENE, SPACE, Location.from_number(home))),
            spot(2, there),
        ]
        assert await store.record_headers(asked) == [*[managed(1).header_bytes] * 2, put(home).record.header_bytes, None]


async def test_a_retry_changes_nothing(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        first = await placed(store, Put(managed(1, expects=EXPECTS_NOTHING)))
        assert await placed(store, Put(managed(1, expects=EXPECTS_NOTHING))) == first
        assert (await store.statistics()).records == 1


async def test_a_newer_version_replaces_the_object_where_it_is(tmp_path: Path) -> None:
    newer = managed(1, seq=2, text=b"newer", expects=managed(1).header.digest)
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(wanted_place(object_id(1)).number)])
        first = await placed(store, Put(managed(1)))
        assert await placed(store, Put(newer)) == first
        assert await store.read([spot(1, first)]) == [newer]
        [result] = await store.put([Put(managed(1, seq=3, expects=EXPECTS_NOTHING))])
        assert (result.outcome, result.current, result.location) == (Outcome.EXISTS, newer.header.digest, first)


@pytest.mark.parametrize("number", range(5))
async def test_an_object_slides_to_the_side_of_the_bound_that_its_home_is_on(tmp_path: Path, number: int) -> None:
    home = wanted_place(object_id(number))
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(home.number, text=b"taken")])
        place = await placed(store, Put(managed(number)))
        kept, gone = Arc(FIRST, home), Arc(place, LAST)
        assert await store.parted(gone) == await store.parted(kept) == 1
        assert await store.slide([gone]) == 0, "its home is in no part"
        assert await store.slide([gone, kept], 3) == 1
        assert await store.slide([gone, kept]) == await store.parted(gone) == 0
        [listed] = [listed for listed, name in await listing(store) if name == object_id(number)]
        assert listed in kept
        # By its old place and by its new one.
        assert await store.read([spot(number, place), spot(number, listed)]) == [managed(number)] * 2
        assert (await store.statistics()).records == 2


async def test_an_object_that_was_given_away_is_placed_anew(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        first = await placed(store, Put(managed(1)))
        assert await store.remove([(spot(1, first), managed(1).header.digest)]) == 1
        [result] = await store.put([Put(managed(1, expects=managed(1).header.digest))])
        assert result.outcome is Outcome.EXISTS
        assert await placed(store, Put(managed(1, expects=EXPECTS_NOTHING))) == first


async def test_a_space_of_both_kinds_is_still_listed(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        location = await placed(store, Put(managed(1)))
        await store.put([put(7)])
        assert dict(await listing(store)) == {location: object_id(1), Location.from_number(7): bytes(16)}


async def test_a_copy_of_an_object_makes_no_second_one(tmp_path: Path) -> None:
    newer, newest = (managed(1, seq=seq, text=b"%d" % seq) for seq in (2, 3))
    home, elsewhere = wanted_place(object_id(1)), Location.from_number(5000)
    async with whole_store(world(), tmp_path) as store:
        here = await placed(store, Put(managed(1)))
        [result] = await store.merge([Put(newer, at=elsewhere)])
        assert result.outcome is Outcome.STORED
        assert await listing(store) == [(here, object_id(1))]
        # Where another node decides, it lies where that one has it: it may be about to become ours there.
        await store.put_holding(arc(0, 9), b"")
        assert await store.digests([spot(1, here), spot(1, elsewhere)]) == [newer.header.digest, None]
        [result] = await store.merge([Put(newest, at=elsewhere)])
        assert result.outcome is Outcome.STORED
        assert await listing(store) == [(elsewhere, object_id(1))]
        [result] = await store.merge([Put(newer, at=here)])
        assert result.outcome is Outcome.STALE
        assert await store.digests([spot(1, here), spot(1, elsewhere)]) == [newest.header.digest, None]
        assert (await store.statistics()).records == 1
        assert [entry.spot for entry in await store.misplaced(Rightful([arc(4000, 6000)]), 9)] == []
        [result] = await store.merge([Put(newest, at=elsewhere)])
        assert [entry.spot for entry in await store.misplaced(Rightful([arc(4000, 6000)]), 9)] == [spot(1, elsewhere)]
        assert await store.misplaced(Rightful([arc(4000, 6000), Arc(home, home)]), 9) == []


async def listing(store: Store) -> list[tuple[Location, bytes]]:
    answer = await store.range(SCENE, SPACE, WHOLE_LINE, 100)
    return list(zip(answer.locations, answer.objects, strict=True))
