"""If this failed, a scene that was ended would stay on the disk, come back, or take another one with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.location import WHOLE_LINE
from scenefold.base.reasons import RejectReason
from scenefold.crypto import RecordPlace
from scenefold.store import Outcome, Put, RangeSum, Spot, Store
from scenefold.store.ending import BATCH_RECORDS
from scenefold.store.log_rows import Votes
from unit.store.log_samples import GENESIS
from unit.store.samples import SCENE, SPACE, managed, object_id, place, put, record, whole_store, world

OTHER = SceneId(SCENE + 1)
OWED = NodeId(9)


async def dropped(store: Store) -> int:
    count = 0
    while gone := await store.drop_scene(SCENE):
        count += gone
    return count


async def test_all_of_it_goes_and_nothing_of_another_scene(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        count = BATCH_RECORDS + 3
        await store.put([Put(record(number)) for number in range(count)], debtors=[[OWED]] * count)
        await store.merge([Put(managed(5), at=place(77_777).location)])
        await store.put_scene_log(SCENE, b"header", b"log")
        await store.put_scene_log(OTHER, b"another header", b"another log")
        await store.put_votes(GENESIS, Votes(store.opened_as, 4))
        assert await store.keeps_of(SCENE, GENESIS) and not await store.keeps_of(SceneId(SCENE + 2), bytes(32))
        await store.let_go(SCENE)
        assert await dropped(store) == count + 1
        await store.drop_scene_log(SCENE, GENESIS)
        assert not await store.keeps_of(SCENE, GENESIS)
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [RangeSum()]
        assert (store.record_count, store.owed) == (0, {})
        assert await store.read([Spot(RecordPlace(SCENE, SPACE, place(5).location), object_id(5))]) == [None]
        assert await store.get_header(SCENE) == b"header", "the header stays"
        assert await store.get_scene_log(SCENE) is None and await store.logs_kept() == frozenset()
        assert await store.get_scene_log(OTHER) == b"another log"


async def test_nothing_of_it_is_taken_any_more_whoever_brings_it_also_after_a_start(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
        assert not store.has_let_go(SCENE)
        store.check_kept(SCENE)
        await store.let_go(SCENE)
        assert [result.outcome for result in await store.merge([put(1, seq=9), put(2)])] == [Outcome.STALE] * 2
        assert [result.outcome for result in await store.put([put(3)])] == [Outcome.STALE]
        assert await store.get_many([place(number) for number in (1, 2, 3)]) == [record(1), None, None]
    async with whole_store(world(), tmp_path) as store:
        assert await store.recall_let_go(SCENE) and not await store.recall_let_go(OTHER)
        assert store.has_let_go(SCENE) and not store.has_let_go(OTHER)
        with pytest.raises(Refused, match="was ended") as told:
            store.check_kept(SCENE)
        assert told.value.reason is RejectReason.MODE_FORBIDS
        assert await dropped(store) == 1
        assert [result.outcome for result in await store.merge([put(1, seq=9)])] == [Outcome.STALE]
