"""If this failed, a handover would leave records behind, take others' along, or delete what was written meanwhile."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location
from scenefold.crypto import EXPECTS_NOTHING, HEADER_BYTES, wanted_place
from scenefold.store import Counts, LmdbDisk, Manifest, Outcome, Put, Rightful, Spot, Store
from scenefold.store.layout import RECORDS, TABLES, SpaceAddress, record_key
from scenefold.store.walking import outside
from scenefold.world.ports import WriteTransaction
from unit.store.samples import SCENE, SPACE, arc, managed, object_id, place, put, record, whole_store, world

STORED_BYTES = 64 + 8 + HEADER_BYTES + 64
LOADED = arc(0, 60)


async def everything(store: Store, piece: Arc, limit: int) -> list[Manifest]:
    pages = [await store.manifest(piece, None, limit)]
    while pages[-1].cursor is not None:
        pages.append(await store.manifest(piece, pages[-1].cursor, limit))
    return pages


async def test_a_manifest_lists_the_records_of_all_spaces_page_by_page(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number, space=space, scene=scene) for scene in (9, 7) for space in (3, 2) for number in (40, 30, 20, 10)])
        for limit in (1, 2, 3, 4, 8, 100):
            pages = await everything(store, arc(15, 30), limit)
            assert all(len(page.entries) <= limit for page in pages)
            entries = [entry for page in pages for entry in page.entries]
            assert [(entry.place.scene, entry.place.space, entry.place.location.number) for entry in entries] == [
                (scene, space, number) for scene in (7, 9) for space in (2, 3) for number in (20, 30)
            ]
        assert {(entry.digest, entry.size) for entry in entries} == {(record(1).header.digest, STORED_BYTES)}
        assert await store.manifest(arc(50, 60), None, 5) == Manifest([], None)


async def test_only_the_very_version_is_removed(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2), put(3)])
        gone = [(entry.spot, entry.digest) for entry in (await store.manifest(arc(1, 2), None, 9)).entries]
        newer = record(2, seq=2, text=b"newer")
        await store.put([Put(newer)])
        assert await store.remove(gone) == 1
        assert await store.remove(gone) == 0
        assert await store.get_many([place(number) for number in (1, 2, 3)]) == [None, newer, record(3)]
        assert (await store.statistics()).spaces == {(SCENE, SPACE): Counts(2, 2 * STORED_BYTES)}
        assert await store.arc_totals(WHOLE_LINE) == Counts(2, 2 * STORED_BYTES)


async def test_copies_are_merged_by_version_wherever_they_lie(tmp_path: Path) -> None:
    """Whatever they expect: that was judged where they were put."""
    old, new = (record(1, seq=seq, text=b"%d" % seq, expects=EXPECTS_NOTHING) for seq in (1, 2))
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(None, b"")
        for copy, outcome in ((old, Outcome.STORED), (new, Outcome.STORED), (old, Outcome.STALE), (new, Outcome.STORED)):
            [result] = await store.merge([Put(copy)])
            assert result.outcome is outcome
        assert await store.get_many([place(1)]) == [new]


async def test_copies_may_use_the_reserve(tmp_path: Path) -> None:
    """What this node takes for its own arc: who adopts a gap must get on. What it holds for others may not use all (test_full_disk.py)."""
    async with whole_store(world(), tmp_path, reserve_bytes=1 << 60) as store:
        [result] = await store.merge([put(1)])
        assert result.outcome is Outcome.STORED


async def test_strays_are_what_lies_outside(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number, space=space) for space in (2, 3) for number in range(0, 100, 10)])

        async def strays(*kept: Arc, held: dict[SpaceAddress, Sequence[Arc]] | None = None) -> list[int]:
            numbers, cursor = [], None
            while True:
                entries, cursor, _ = await store.strays(Rightful(kept, held), cursor, 3)
                numbers += [entry.place.location.number for entry in entries if entry.place.space == 2]
                if cursor is None:
                    return numbers

        assert await strays(arc(20, 60)) == [0, 10, 70, 80, 90]
        assert await strays(arc(20, 60), arc(70, 80), arc(0, 0)) == [10, 90]
        assert await strays() == list(range(0, 100, 10))
        assert await strays(WHOLE_LINE) == []
        this, other = (SCENE, SpaceId(2)), (SCENE, SpaceId(3))
        assert await strays(arc(20, 60), held={other: [WHOLE_LINE]}) == [0, 10, 70, 80, 90]
        assert await strays(arc(20, 60), held={this: [arc(0, 5), arc(61, 80)]}) == [10, 90]
        assert await strays(held={this: [WHOLE_LINE]}) == []


async def test_an_object_belongs_where_its_home_is_and_not_where_it_lies(tmp_path: Path) -> None:
    this = SCENE, SPACE
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(None, b"")
        home, elsewhere = wanted_place(object_id(1)), Location.from_number(5)
        await store.merge([Put(managed(1), at=elsewhere)])

        async def found(kept: Sequence[Arc], held: Sequence[Arc]) -> tuple[int, int]:
            rightful = Rightful(kept, {this: held})
            return len((await store.strays(rightful, None, 9)).entries), len(await store.misplaced(rightful, 9))

        there, here = Arc(home, home), Arc(elsewhere, elsewhere)
        assert await found([], []) == (1, 0)
        assert await found([], [there]) == (0, 0), "held at another place than its own"
        assert await found([here], []) == (0, 1), "in the way of what is this node's"
        assert await found([here], [there]) == (0, 0)
        await store.put_holding(here, b"")
        assert [await store.beside(Rightful([here], {this: held})) for held in ([], [there])] == [0, 1]
        assert await store.slide([there]) == 1
        assert await store.beside(Rightful([here], {this: [there]})) == 0
        await store.merge([Put(managed(1), at=elsewhere)])
        assert await store.parted(here) == 0, "this node does not decide about it"


async def test_weighing_from_both_sides(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number, space=space) for space, numbers in ((2, (10, 30, 50)), (3, (20, 30, 40))) for number in numbers])

        async def weigh(records: int, *, from_right: bool, piece: Arc = LOADED) -> tuple[int, int]:
            found = await store.weigh(piece, records * STORED_BYTES, from_right=from_right)
            assert found.bytes == found.records * STORED_BYTES
            return found.location.number, found.records

        assert [await weigh(wanted, from_right=False) for wanted in (1, 2, 3, 4, 5, 99)] == [
            (10, 1),
            (20, 2),
            (30, 4),
            (30, 4),
            (40, 5),
            (50, 6),
        ]
        assert [await weigh(wanted, from_right=True) for wanted in (1, 2, 3, 4, 5, 99)] == [
            (50, 1),
            (40, 2),
            (30, 4),
            (30, 4),
            (20, 5),
            (10, 6),
        ]
        assert await weigh(1, from_right=True, piece=arc(0, 45)) == (40, 1)
        assert await weigh(1, from_right=True, piece=arc(11, 15)) == (15, 0)
        assert await weigh(1, from_right=False, piece=arc(11, 15)) == (11, 0)


async def test_a_record_at_each_end_of_the_line(tmp_path: Path) -> None:
    ends = [0, (1 << 160) - 1]
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number) for number in ends])
        pages = await everything(store, WHOLE_LINE, 1)
        assert [entry.place.location.number for page in pages for entry in page.entries] == ends
        assert (await store.weigh(WHOLE_LINE, 1, from_right=True)).location == LAST
        assert (await store.weigh(WHOLE_LINE, 1, from_right=False)).location == FIRST


async def test_node_managed_records_are_listed_read_and_removed_alike(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        copy = managed(1)
        await store.put_holding(None, b"")
        await store.merge([Put(copy, at=Location.from_number(5)), put(5)])
        [first, second] = (await store.manifest(arc(5, 5), None, 9)).entries
        assert (first.object, second.object) == (b"", copy.header.location[4:])
        assert await store.read([second.spot, first.spot, Spot(place(5), bytes(16))]) == [copy, record(5), None]
        assert await store.remove([(second.spot, second.digest)]) == 1
        assert await store.read([second.spot]) == [None]


NUMBERS = st.integers(0, 30)


@given(st.lists(st.tuples(NUMBERS, NUMBERS).map(lambda ends: arc(min(ends), max(ends))), max_size=5), st.integers(0, 40))
def test_every_place_is_inside_or_outside_and_never_both(pieces: list[Arc], number: int) -> None:
    location = Location.from_number(number)
    rest = outside(pieces)
    assert any(location in piece for piece in pieces) != any(location in piece for piece in rest)
    assert all(one.last < other.first for one, other in itertools.pairwise(rest))


ARCS = st.lists(st.tuples(NUMBERS, NUMBERS).map(lambda ends: arc(min(ends), max(ends))), max_size=5)


@given(ARCS, ARCS, st.integers(0, 40))
def test_a_stray_is_what_no_arc_of_its_space_has(kept: list[Arc], held: list[Arc], number: int) -> None:
    location, this, other = Location.from_number(number), (SCENE, SpaceId(2)), (SCENE, SpaceId(3))
    rightful = Rightful(kept, {this: held})
    assert rightful.is_stray(this, location) != any(location in piece for piece in (*kept, *held))
    assert rightful.is_stray(other, location) != any(location in piece for piece in kept)


def test_nothing_is_outside_of_the_whole_line() -> None:
    assert outside([]) == [WHOLE_LINE]
    assert outside([WHOLE_LINE, arc(1, 2)]) == []


@pytest.mark.expect_log("changed on the disk")
async def test_only_damaged_records_are_discarded(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number) for number in (1, 2, 3)])
    environment = LmdbDisk().open(tmp_path, TABLES)

    def spoil(transaction: WriteTransaction) -> None:
        for number, changed in ((1, 20), (2, -1)):
            value = bytearray(transaction.get(RECORDS, record_key(place(number))) or b"")
            value[changed] ^= 1
            transaction.put(RECORDS, record_key(place(number)), bytes(value))

    environment.update(spoil)
    environment.close()
    async with whole_store(world(), tmp_path) as store:
        page = await store.manifest(WHOLE_LINE, None, 9)
        assert page.damaged == (Spot(place(1)),), "its header"
        first = await store.strays(Rightful(()), None, 1)
        assert not first.entries and first.cursor is not None, "what has rotted is no entry, and not the end"
        assert [entry.spot for entry in (await store.strays(Rightful(()), first.cursor, 1)).entries] == [Spot(place(2))]
        assert [isinstance(found, DamagedData) for found in await store.read([entry.spot for entry in page.entries])] == [True, False]
        assert await store.discard([Spot(place(number)) for number in (1, 2, 3, 4)]) == 2
        assert await store.get_many([place(number) for number in (1, 2, 3)]) == [None, None, record(3)]
        assert (await store.statistics()).spaces == {(SCENE, SPACE): Counts(1, STORED_BYTES)}


@pytest.mark.parametrize("way", ["put", "merge"])
async def test_a_version_that_has_rotted_is_not_said_to_be_here_and_the_same_version_heals_it(tmp_path: Path, way: str) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2)])
    environment = LmdbDisk().open(tmp_path, TABLES)

    def spoil(transaction: WriteTransaction) -> None:
        value = bytearray(transaction.get(RECORDS, record_key(place(1))) or b"")
        value[-1] ^= 1
        transaction.put(RECORDS, record_key(place(1)), bytes(value))

    environment.update(spoil)
    environment.close()
    async with whole_store(world(), tmp_path) as store:
        assert await store.digests([Spot(place(1)), Spot(place(2))]) == [None, record(2).header.digest]
        (result,) = await (store.put if way == "put" else store.merge)([put(1)])
        assert result.outcome is Outcome.STORED
        assert await store.get_many([place(1), place(2)]) == [record(1), record(2)]
        assert (await store.statistics()).spaces == {(SCENE, SPACE): Counts(2, 2 * STORED_BYTES)}
