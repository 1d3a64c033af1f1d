"""If this fails, deleted records stay on disks for ever, or come back from the disk of a node that was away."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest
import trio

from integration.living_clusters import Living, living_cluster
from integration.whole_copies import whole
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client import Scene, Space
from scenefold.store import LmdbDisk
from scenefold.store.layout import RECORDS, SUSPECTS, TABLES, location_of

COUNT = 60
PLACES = [Location.from_number(LINE_LENGTH * index // COUNT) for index in range(COUNT)]
DELETED = PLACES[::3]
PATIENCE_S = 90.0
LOOK_S = 1.0


@asynccontextmanager
async def filled(folder: Path) -> AsyncIterator[tuple[Living, Scene, Space]]:
    """Three nodes, and a space of which each holds all."""
    async with living_cluster(folder, 3, options=("--remove-after", "13")) as living:
        scene = await living.cluster.scenes.open("kept")
        space = await scene.create_space("things", copies=3, copies_min=2)
        await space.put_many((place, bytes(place) * 8) for place in PLACES)
        yield living, scene, space


async def purged(scene: Scene, count: int) -> None:
    """Once so many deletions are gone, and no more are left. Until nodes have compared what they hold, some have to wait."""
    gone = 0
    with trio.fail_after(PATIENCE_S):
        while True:
            report = await scene.purge()
            gone += report.purged
            if report.is_complete:
                break
    assert (gone, report.kept, report.overtaken) == (count, 0, 0)


async def check_readable(space: Space) -> None:
    found = await space.get_many(PLACES)
    assert found == [None if place in DELETED else bytes(place) * 8 for place in PLACES]


def places_on(folder: Path, space: Space, table: str) -> list[Location]:
    """Where on a disk something lies of a space. The node must not run."""
    environment = LmdbDisk().open(folder, TABLES)
    try:
        with environment.read() as view:
            keys = view.keys(table, b"", b"\xff" * 64)
            return [location_of(key) for key in keys if int.from_bytes(key[4:6], "big") == space.id]
    finally:
        environment.close()


async def test_nothing_is_left_of_what_was_purged(tmp_path: Path) -> None:
    async with filled(tmp_path) as (living, scene, space):
        for place in DELETED:
            await space.delete(place)
        looked = await scene.purge(dry_run=True)
        assert (looked.deleted, looked.can_go, looked.purged) == (len(DELETED), len(DELETED), 0)
        await purged(scene, len(DELETED))
        await check_readable(space)
        assert [place async for place in space.query(deleted=True)] == [place for place in PLACES if place not in DELETED]
        await space.put(DELETED[0], b"anew")
        assert await space.get(DELETED[0]) == b"anew"
        for address in living.nodes.addresses:
            await living.nodes.kill(address)
        for address in living.nodes.addresses:
            left = places_on(living.nodes.folder / "data" / address, space, RECORDS)
            assert set(left) <= {place for place in PLACES if place not in DELETED} | {DELETED[0]}
            assert len(left) >= len(PLACES) - len(DELETED)


@pytest.mark.slow
@pytest.mark.timeout(720)
@pytest.mark.long
async def test_who_was_away_brings_nothing_back(tmp_path: Path) -> None:
    async with filled(tmp_path) as (living, scene, space):
        nodes = living.nodes
        away = nodes.addresses[-1]
        # All that was put has to be there, or it comes back with less than was deleted.
        await whole(living, 3, PATIENCE_S)
        await nodes.kill(away)
        assert places_on(nodes.folder / "data" / away, space, RECORDS) == PLACES
        await living.until(lambda status: away not in [node.address for node in status.nodes])
        for place in DELETED:
            await space.delete(place)
        await purged(scene, len(DELETED))
        await check_readable(space)
        nodes.start(away)
        await nodes.wait([away], joined=False)
        kept = 0
        with trio.fail_after(2 * PATIENCE_S):
            while kept < len(DELETED):
                await trio.sleep(LOOK_S)
                kept = (await scene.strays()).records
                await check_readable(space)
        # What the others have as well goes in the course of time; what was purged stays.
        # The node looks ever more seldom: after 5, 15, 35, 75, 155 and 315 s.
        shown = await scene.strays()
        with trio.fail_after(4 * PATIENCE_S):
            while shown.records > len(DELETED):
                await trio.sleep(LOOK_S)
                shown = await scene.strays()
        assert sorted(stray.location for stray in shown.listed) == DELETED
        assert {stray.kept_by for stray in shown.listed} == {(away,)}
        health = await living.cluster.health()
        assert health.kept_apart == len(DELETED)
        await check_readable(space)
        gone = await scene.strays(discard=True)
        assert (gone.discarded, gone.left) == (len(DELETED), 0)
        await check_readable(space)
        await nodes.kill(away)
        assert not places_on(nodes.folder / "data" / away, space, SUSPECTS)
