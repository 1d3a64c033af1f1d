"""If this fails, a crash leaves a scene's public header and its sealed log at different positions, and nobody can open the log."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.world import offline_world
from scenefold.world.ports import DiskFull
from unit.store.samples import SCENE, whole_store, world
from unit.store.test_full_disk import TroubledDisk


async def test_header_and_log_are_there_after_opening_again(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        before = store.commits
        await store.put_scene_log(SCENE, b"header 1", b"log 1")
        assert store.commits == before + 1, "one transaction"
        await store.put_header(SceneId(8), b"somebody else's")
    async with whole_store(world(), tmp_path) as store:
        assert await store.get_header(SCENE) == b"header 1"
        assert await store.get_scene_log(SCENE) == b"log 1"
        assert await store.get_scene_log(SceneId(8)) is None
        assert await store.headers() == {SCENE: b"header 1", SceneId(8): b"somebody else's"}


async def test_on_a_full_disk_both_stay_as_they_were(tmp_path: Path) -> None:
    disk = TroubledDisk()
    async with whole_store(offline_world(disk=disk), tmp_path) as store:
        await store.put_scene_log(SCENE, b"header 1", b"log 1")
        disk.trouble = DiskFull("no room")
        with pytest.raises(Refused):
            await store.put_scene_log(SCENE, b"header 2", b"log 2")
        disk.trouble = None
        assert (await store.get_header(SCENE), await store.get_scene_log(SCENE)) == (b"header 1", b"log 1")
