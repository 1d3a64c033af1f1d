"""If this failed, a node that was away would bring back what was deleted and purged meanwhile, or lose what it has kept."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenefold.base.ids import SceneId
from scenefold.base.location import WHOLE_LINE
from scenefold.crypto import Record, RecordPlace, version_key
from scenefold.store import Put, RangeSum, Spot, Store, open_store
from scenefold.store.layout import RECORDS, SUSPECTS, TABLES, record_key
from scenefold.world import WriteTransaction
from unit.store.samples import NODE, SCENE, SPACE, managed, object_id, place, record, whole_store, world

OTHER = SceneId(8)


def spot(number: int, scene: int = SCENE) -> Spot:
    return Spot(place(number, scene=scene))


async def suspects_of(store: Store, scene: SceneId | None = None) -> list[Spot]:
    return [held.spot for held in (await store.suspects(scene, b"", 1000)).records]


async def test_only_a_renewed_identity_has_a_former_life_and_only_until_it_was_looked_through(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(record(1))])
        assert not await store.has_former_life()
        await store.renew_identity()
        assert await store.has_former_life()
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.has_former_life()
        await store.end_former_life()
        await store.end_former_life()
        assert not await store.has_former_life()
        assert await store.get_many([place(1)]) == [record(1)]


async def test_what_is_older_than_a_purge_is_set_aside_and_lies_nowhere_any_more(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(record(number, epoch=number)) for number in range(1, 7)])
        await store.put([Put(record(number, epoch=1, scene=OTHER)) for number in (1, 2)])
        assert await store.scenes_kept() == [SCENE, OTHER]
        assert await store.set_aside(SCENE, 4) == 3
        assert await store.set_aside(SCENE, 4) == 0
        gone = [number for number in range(1, 7) if await store.get_many([place(number)]) == [None]]
        assert gone == [1, 2, 3]
        assert await suspects_of(store) == await suspects_of(store, SCENE) == [spot(1), spot(2), spot(3)]
        assert await suspects_of(store, OTHER) == []
        assert await store.suspect_counts() == {SCENE: 3}
        # All that is derived of records follows: sums, counts, lists.
        (total,) = await store.sums(SCENE, SPACE, [WHOLE_LINE])
        assert total.records == 3 == len((await store.listing(SCENE, SPACE, WHOLE_LINE, 10)).records)
        assert (await store.statistics()).records == 5
        assert [held.spot for held in (await store.held(WHOLE_LINE, b"", 100)).records][:3] == [spot(4), spot(5), spot(6)]
        assert await store.suspect_records([spot(2), spot(5)]) == [record(2, epoch=2), None]


async def test_suspects_are_listed_in_pages(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(record(number)) for number in range(5)] + [Put(record(9, scene=OTHER))])
        await store.set_aside(SCENE, 1)
        await store.set_aside(OTHER, 1)
        seen: list[Spot] = []
        cursor: bytes | None = b""
        while cursor is not None:
            page = await store.suspects(SCENE, cursor, 2)
            seen += [held.spot for held in page.records]
            cursor = page.cursor
        assert seen == [spot(number) for number in range(5)]
        assert len((await store.suspects(None, b"", 100)).records) == 6


async def test_only_the_very_version_is_discarded(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(record(1)), Put(record(2))])
        await store.set_aside(SCENE, 1)
        right, wrong = record(1).header.digest, record(2, text=b"another").header.digest
        assert await store.discard_suspects([(spot(1), right), (spot(2), wrong), (spot(3), right)]) == 1
        assert await suspects_of(store) == [spot(2)]


async def test_of_two_lives_the_newer_version_stays(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        for versions in ((record(1, seq=5), record(2, seq=1)), (record(1, seq=4), record(2, seq=2))):
            await store.put(list(map(Put, versions)))
            await store.set_aside(SCENE, 1)
        assert await store.suspect_records([spot(1), spot(2)]) == [record(1, seq=5), record(2, seq=2)]


async def test_objects_are_set_aside_with_their_names(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        (result,) = await store.put([Put(managed(1))])
        assert result.location is not None
        await store.set_aside(SCENE, 1)
        where = Spot(RecordPlace(SCENE, SPACE, result.location), object_id(1))
        assert await suspects_of(store) == [where]
        assert await store.suspect_records([where]) == [managed(1)]
        assert (await store.sums(SCENE, SPACE, [WHOLE_LINE])) == [RangeSum()]


async def test_what_has_rotted_is_shown_to_nobody_and_can_be_discarded(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(record(number)) for number in (1, 2, 3)])
    _spoil(tmp_path, RECORDS, 1)
    async with open_store(world(), tmp_path, NODE) as store:
        # Nobody knows how old it is, and nobody would take it.
        assert await store.set_aside(SCENE, 1) == 2
        assert await store.get_many([place(1)]) == [None]
    _spoil(tmp_path, SUSPECTS, 2)
    async with open_store(world(), tmp_path, NODE) as store:
        assert await suspects_of(store) == [spot(3)]
        assert await store.suspect_counts() == {SCENE: 2}
        assert await store.discard_suspects([(spot(2), bytes(32))]) == 1


def _spoil(folder: Path, table: str, number: int) -> None:
    """Turn a bit in the header of what lies at a place."""
    environment = world().disk.open(folder, TABLES)
    key = record_key(place(number))

    def turn(transaction: WriteTransaction) -> None:
        value = bytearray(transaction.get(table, key) or b"")
        value[20] ^= 1
        transaction.put(table, key, bytes(value))

    environment.update(turn)
    environment.close()


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(epochs=st.lists(st.tuples(st.integers(0, 6), st.integers(0, 3)), max_size=30), below=st.integers(0, 7))
def test_nothing_is_lost_and_nothing_older_left(
    tmp_path_factory: pytest.TempPathFactory, epochs: list[tuple[int, int]], below: int
) -> None:
    async def check() -> None:
        folder = tmp_path_factory.mktemp("store")
        newest: dict[int, Record] = {}
        async with whole_store(world(), folder) as store:
            for seq, (epoch, number) in enumerate(epochs, 1):
                one = record(number, epoch=epoch, seq=seq)
                await store.put([Put(one)])
                if number not in newest or version_key(one.header) > version_key(newest[number].header):
                    newest[number] = one
            moved = await store.set_aside(SCENE, below)
            for number, one in newest.items():
                is_old = one.header.epoch < below
                assert await store.get_many([place(number)]) == [None if is_old else one]
                assert await store.suspect_records([spot(number)]) == [one if is_old else None]
            assert moved == len(await suspects_of(store))

    trio.run(check)
