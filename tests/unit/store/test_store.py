"""If this failed, the store would lose, confuse or invent records, or count them wrongly."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_NOTHING, HEADER_BYTES, Record
from scenefold.store import Counts, Outcome, Put, PutResult
from unit.store.samples import SCENE, SPACE, arc, place, put, record, whole_store, world


async def test_what_is_put_is_there_after_opening_again(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path / "data") as store:
        assert await store.put([put(1), put(2, size=60_000)]) == [
            PutResult(Outcome.STORED, record(1).header.digest),
            PutResult(Outcome.STORED, record(2, size=60_000).header.digest),
        ]
        await store.put_header(SCENE, b"public")
        await store.put_note("bound", b"\x01")
    async with whole_store(world(), tmp_path / "data") as store:
        assert await store.get_many([place(2), place(3), place(1)]) == [record(2, size=60_000), None, record(1)]
        assert await store.get_header(SCENE) == b"public"
        assert await store.get_header(SceneId(8)) is None
        assert await store.headers() == {SCENE: b"public"}
        assert await store.get_note("bound") == b"\x01"
        assert await store.get_note("other") is None


async def test_versions_and_expectations(tmp_path: Path) -> None:
    first, hasty = record(1, seq=1, text=b"a", expects=EXPECTS_NOTHING), record(1, seq=2, text=b"b", expects=EXPECTS_NOTHING)
    second = record(1, seq=2, text=b"b", expects=first.header.digest)
    async with whole_store(world(), tmp_path) as store:
        results = await store.put([Put(new) for new in (first, hasty, second, record(1, seq=1, text=b"c"), second, hasty)])
        assert [result.outcome for result in results] == [
            Outcome.STORED,
            Outcome.EXISTS,
            Outcome.STORED,
            Outcome.STALE,
            Outcome.STORED,
            Outcome.EXISTS,
        ]
        assert results[1].current == first.header.digest
        assert await store.get_many([place(1)]) == [second]
        assert (await store.statistics()).records == 1


async def test_of_many_who_expect_nothing_there_one_wins(tmp_path: Path) -> None:
    outcomes: list[Outcome] = []
    async with whole_store(world(), tmp_path) as store:

        async def try_one(number: int) -> None:
            [result] = await store.put([put(1, text=b"%d" % number, expects=EXPECTS_NOTHING)])
            outcomes.append(result.outcome)

        async with trio.open_nursery() as nursery:
            for number in range(50):
                nursery.start_soon(try_one, number)
    assert sorted(outcome.value for outcome in outcomes) == ["exists"] * 49 + ["stored"]


async def test_range_is_in_order_and_says_what_it_covers(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number) for number in (30, 10, 20, (1 << 160) - 1, 0)])
        await store.put([put(15, space=SPACE + 1), put(15, scene=SCENE + 1)])
        answer = await store.range(SCENE, SPACE, arc(10, 40), 10)
        assert [location.number for location in answer.locations] == [10, 20, 30]
        assert (answer.covered, answer.complete) == (arc(10, 40), True)
        answer = await store.range(SCENE, SPACE, arc(5, 40), 2)
        assert [location.number for location in answer.locations] == [10, 20]
        assert (answer.covered, answer.complete) == (arc(5, 20), False)
        answer = await store.range(SCENE, SPACE, arc(10, 30), 3)
        assert answer.complete
        whole = await store.range(SCENE, SPACE, arc(0, (1 << 160) - 1), 100)
        assert len(whole.locations) == 5
        assert (await store.range(SceneId(99), SpaceId(1), arc(0, 1), 1)).locations == []


async def test_statistics_follow_every_change(tmp_path: Path) -> None:
    overhead = 8 + HEADER_BYTES + 64
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, size=100), put(2, size=200), put(1, space=5, size=50)])
        await store.put([put(1, seq=2, size=1000)])
        await store.put([put(1, seq=1, size=9)])
    async with whole_store(world(), tmp_path) as store:
        statistics = await store.statistics()
    assert statistics.spaces == {(SCENE, SPACE): Counts(2, 1200 + 2 * overhead), (SCENE, 5): Counts(1, 50 + overhead)}
    assert (statistics.records, statistics.bytes) == (3, 1250 + 3 * overhead)
    assert 0 < statistics.disk_used_bytes < statistics.disk_total_bytes


async def test_more_reads_than_one_batch(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(number) for number in range(300)])
        records = await store.get_many([place(number) for number in range(300)])
    assert [found.header.location.number for found in records if found] == list(range(300))


async def test_the_map_grows_under_readers(tmp_path: Path) -> None:
    async with whole_store(world(map_bytes=1 << 18), tmp_path) as store:
        done = trio.Event()
        await store.put([put(0)])

        async def read() -> None:
            while not done.is_set():
                assert await store.get_many([place(0)]) == [record(0)]

        async with trio.open_nursery() as nursery:
            nursery.start_soon(read)
            nursery.start_soon(read)
            for start in range(1, 200, 20):
                results = await store.put([put(number, size=60_000) for number in range(start, start + 20)])
                assert all(result.outcome is Outcome.STORED for result in results)
            done.set()
        assert (await store.statistics()).records == 201


@pytest.mark.expect_log("full but for its reserve")
async def test_below_the_reserve_new_records_are_refused(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
    async with whole_store(world(), tmp_path, reserve_bytes=1 << 60) as store:
        for _ in range(3):
            [result] = await store.put([put(2)])
            assert result == PutResult(Outcome.FULL)
        assert result.reason is RejectReason.STORAGE_FULL
        assert await store.get_many([place(1), place(2)]) == [record(1), None]
        await store.put_note("bound", b"still possible")


async def test_an_ill_formed_record_harms_nobody_else(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        with pytest.raises(DamagedData):
            await store.put([put(1), Put(Record(b"short", bytes(64), b""))])
        [result] = await store.put([put(1)])
        assert result.outcome is Outcome.STORED


async def test_a_cancelled_put_leaves_the_store_usable(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        async with trio.open_nursery() as nursery:
            for number in range(20):
                nursery.start_soon(store.put, [put(number, size=60_000)])
            await trio.lowlevel.checkpoint()
            nursery.cancel_scope.cancel()
        [result] = await store.put([put(100)])
        assert result.outcome is Outcome.STORED


async def test_a_put_after_the_end_is_refused(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        pass
    with pytest.raises(Refused) as caught:
        await store.put([put(1)])
    assert caught.value.reason is RejectReason.NOT_READY
