"""If this failed, records of node-managed spaces would be stored twice, lost when they slide, or overwrite each other."""

from __future__ import annotations

from pathlib import Path

from scenefold.base.location import WHOLE_LINE, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.store import Outcome, Put, Spot, Store
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


async def test_it_takes_a_free_place_of_its_own_arc(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(100, 109), b"")
        places = [await placed(store, Put(managed(number))) for number in range(10)]
        assert sorted(location.number for location in places) == list(range(100, 110))
        # No place is free any more: objects share one, and are still told apart.
        shared = await placed(store, Put(managed(10)))
        assert await store.read([spot(number, places[number]) for number in range(10)]) == [managed(number) for number in range(10)]
        assert await store.read([spot(10, shared)]) == [managed(10)]
        answer = await store.range(SCENE, SPACE, arc(100, 109), 100)
        assert sorted(answer.objects) == sorted(object_id(number) for number in range(11))
        assert len(answer.locations) == 11


async def test_a_retry_changes_nothing(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(100, 200), b"")
        first = await placed(store, Put(managed(1), b""))
        assert await placed(store, Put(managed(1), b"")) == first
        assert (await store.statistics()).records == 1


async def test_a_newer_version_replaces_the_object_where_it_is(tmp_path: Path) -> None:
    newer = managed(1, seq=2, text=b"newer")
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(100, 200), b"")
        first = await placed(store, Put(managed(1)))
        assert await placed(store, Put(newer, managed(1).header.digest, at=first)) == first
        assert await store.read([spot(1, first)]) == [newer]
        [result] = await store.put([Put(managed(1, seq=3), b"", at=first)])
        assert (result.outcome, result.current, result.location) == (Outcome.EXISTS, newer.header.digest, first)
        [result] = await store.put([Put(managed(2), at=Location.from_number(99))])
        assert result.outcome is Outcome.NOT_OWNED


async def test_objects_slide_out_of_a_piece_and_are_found_by_id(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(0, 999), b"")
        await store.put([put(number, space=SPACE + 1) for number in range(0, 1000, 50)])
        places = [await placed(store, Put(managed(number))) for number in range(40)]
        kept, gone = arc(0, 499), arc(500, 999)
        leaving = sum(location in gone for location in places)
        assert leaving > 5
        assert await store.slide(gone, kept, 3) == 3
        assert await store.slide(gone, kept) == leaving - 3
        assert await store.slide(gone, kept) == 0
        answer = await store.range(SCENE, SPACE, WHOLE_LINE, 100)
        assert sorted(answer.objects) == sorted(object_id(number) for number in range(40))
        assert all(location in kept for location in answer.locations)
        # By its old place and by its new one.
        assert await store.read([spot(number, places[number]) for number in range(40)]) == [managed(number) for number in range(40)]
        assert (await store.arc_totals(gone)).records == 10
        assert (await store.statistics()).records == 60


async def test_an_object_that_was_given_away_is_placed_anew(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(0, 999), b"")
        first = await placed(store, Put(managed(1)))
        assert await store.remove([(spot(1, first), managed(1).header.digest)]) == 1
        [result] = await store.put([Put(managed(1), managed(1).header.digest)])
        assert result.outcome is Outcome.EXISTS
        assert await placed(store, Put(managed(1), b"")) == first


async def test_a_space_of_both_kinds_is_still_listed(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        location = await placed(store, Put(managed(1)))
        await store.put([put(7)])
        answer = await store.range(SCENE, SPACE, WHOLE_LINE, 10)
        assert dict(zip(answer.locations, answer.objects, strict=True)) == {location: object_id(1), Location.from_number(7): bytes(16)}


async def test_a_copy_of_an_object_that_has_slid_makes_no_second_one(tmp_path: Path) -> None:
    newer = managed(1, seq=2, text=b"newer")
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(arc(0, 999), b"")
        here = await placed(store, Put(managed(1)))
        elsewhere = Location.from_number(5000)
        assert await store.digests([spot(1, elsewhere), spot(2, elsewhere)]) == [managed(1).header.digest, None]
        [result] = await store.merge([Put(newer, at=elsewhere)])
        assert result.outcome is Outcome.STORED
        assert (await store.range(SCENE, SPACE, WHOLE_LINE, 9)).locations == [here]
        assert await store.digests([spot(1, elsewhere)]) == [newer.header.digest]
        # What lies outside of the arc is nothing to go by: it may be about to be deleted.
        await store.put_holding(arc(4000, 6000), b"")
        assert await store.digests([spot(1, elsewhere)]) == [None]
        [result] = await store.merge([Put(newer, at=elsewhere)])
        assert result.outcome is Outcome.STORED
        assert sorted((await store.range(SCENE, SPACE, WHOLE_LINE, 9)).locations) == sorted([here, elsewhere])
