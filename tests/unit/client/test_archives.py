"""If one fails, a scene that was archived does not come back as it was, or harms what lies where it is brought."""

from __future__ import annotations

import json
import tarfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, ScenefoldError, Unreachable, UsageFault
from scenefold.base.location import Location
from scenefold.client.progress import ProgressState
from scenefold.client.restoring import RestoreOptions
from scenefold.client.scene import Scene
from scenefold.client.scenes import Scenes
from scenefold.crypto import SigningKey
from scenefold.scene.layout import FILES, META, RENDERS
from scenefold.simulation.clients import secrets_of
from scenefold.wire import PutMany, RenderSettings
from scenefold.world.keyring import Keyring
from unit.client.fake_nodes import ORIGIN, FakeNodes

WRITER = SigningKey(bytes(31) + b"\1")
AGAIN = RestoreOptions(resume=True)
LAST_PUT = Location.from_number(9)
FILES_MANY = 300
"""More than one part of an index holds."""


class Site:
    """A cluster and a user of it."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.nodes = FakeNodes()
        self.scenes = Scenes(self.nodes.calls(), Keyring(folder), secrets_of(WRITER), ORIGIN)


@pytest.fixture
def here(tmp_path: Path) -> Site:
    return Site(tmp_path / "here")


@pytest.fixture
def there(tmp_path: Path) -> Site:
    return Site(tmp_path / "there")


async def made(site: Site) -> Scene:
    """A scene with all that an archive holds, and a deleted record."""
    scene = await site.scenes.create("kitchen", copies=1)
    hall = await scene.create_space("hall", ((-4.0, 0.1), (4.0, 0.7)), curve="z-order", copies=2)
    await hall.put_at((1.0, 0.5), b"before it was moved")
    await hall.translate((0.1, -2.0))
    await hall.put_at((1.0, -1.5), b"after that")
    await hall.scale(1 / 3)
    await hall.put_at((0.2, -0.5), b"after all")
    objects = await scene.create_space("objects", node_managed=True, render_output=True)
    for number in range(3):
        await objects.put_managed(b"thing %d" % number)
    await scene.space(RENDERS).put_managed(b"a render")
    files = scene.space(FILES)
    await files.put_many((Location.from_number(number << 140), b"%d" % number * 9) for number in range(1, FILES_MANY + 1))
    await files.put(Location.from_number(5), b"deleted")
    await files.delete(Location.from_number(5))
    await files.put(Location.from_number(6), b"")
    await scene.change_render_settings(partial(replace, width=64, height=32, sky=(0.5, 0.0, 1.0), camera="door"))
    await scene.space(META).put(LAST_PUT, bytes(range(256)) * 240)
    return scene


def files_of(place: Path) -> dict[str, bytes]:
    """The records of an archive, by the names of their files, read with what everybody has."""
    with tarfile.open(place, "r:") as tar:
        return {told.name: tar.extractfile(told).read() for told in tar if told.name.startswith("spaces/")}  # type: ignore[union-attr]


def spaces_of(place: Path) -> list[dict[str, Any]]:
    """What an archive says of the spaces, but for positions of the log."""
    with tarfile.open(place, "r:") as tar:
        spaces = json.loads(tar.extractfile("scene.json").read())["spaces"]  # type: ignore[union-attr]
    for space in spaces:
        del space["created"]
        for step in space["steps"]:
            del step["position"]
    return list(spaces)


async def test_a_scene_comes_back_byte_for_byte(autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site) -> None:
    place, again = tmp_path / "kitchen.tar", tmp_path / "again.tar"
    states: list[ProgressState] = []
    scene = await made(here)
    exported = await scene.export(place, states.append)
    living = 3 + 3 + 1 + FILES_MANY + 1 + 1
    assert (exported.records, exported.listed) == (living, living + 1), "the deleted one is left out"
    assert exported.spaces["hall"] == 3 and (states[-1].done, states[-1].total) == (living + 1, living + 1)
    back, restored = await there.scenes.import_archive("pantry", place)
    assert (restored.records, restored.reused, restored.bytes, restored.renumbered) == (living, 0, exported.bytes, {})
    shown = await back.render_settings()
    assert shown.settings == (await scene.render_settings()).settings == RenderSettings(64, 32, sky=(0.5, 0.0, 1.0), camera="door")
    await back.export(again)
    assert files_of(again) == files_of(place) and len(files_of(place)) == living
    assert spaces_of(again) == spaces_of(place)


async def test_positions_mean_what_they_meant(autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site) -> None:
    place = tmp_path / "kitchen.tar"
    before = await (await made(here)).space_named("hall")
    await before.translate((7.0, 7.0))
    scene = await here.scenes.open("kitchen")
    await scene.export(place)
    back, _ = await there.scenes.import_archive("pantry", place)
    after = await back.space_named("hall")
    boxes = [(await hall.info()).world_box for hall in (before, after)]
    assert boxes[0] == boxes[1]
    found = [{one.location: one.position async for one in hall.query_box(*boxes[0])} for hall in (before, after)]
    assert found[0] == found[1] and len(found[0]) == 3
    for location in found[0]:
        carried = []
        for hall in (before, after):
            [record] = await hall.read([location])
            assert record is not None
            carried.append((record.payload, (await hall.info()).fast_forward([(1.0, 0.5)], record.content_position).tolist()))
        assert carried[0] == carried[1], "coordinates in payloads are carried on alike"


async def test_a_number_that_is_taken_is_changed_and_said(autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site) -> None:
    place = tmp_path / "kitchen.tar"
    await (await made(here)).export(place)
    back, restored = await there.scenes.import_archive("pantry", place, RestoreOptions(copies=3))
    assert {name: number for name, number in restored.renumbered.items() if name == "hall"} == {"hall": 31}
    spaces = {space.name: space for space in await back.spaces() if not space.parent}
    assert {(space.copies, space.copies_min) for space in spaces.values()} == {(3, 2)}
    [first] = [location async for location in back.space(31).query()][:1]
    assert await back.space(31).get(first) is not None


def fail_after(nodes: FakeNodes, count: int) -> Iterator[None]:
    """All nodes go away once they have taken so many writes."""
    request, left = nodes.request, count

    async def failing(address: str, priority: Any, packet: Any, timeout: float) -> Any:
        nonlocal left
        if isinstance(packet, PutMany):
            left -= 1
            if left < 0:
                raise Unreachable("the node was switched off", where=address)
        return await request(address, priority, packet, timeout)

    nodes.request = failing  # type: ignore[method-assign]
    yield
    nodes.request = request  # type: ignore[method-assign]


@pytest.mark.parametrize("writes", [0, 2, 4])
async def test_an_import_that_ended_goes_on_and_shows_nothing_before(
    autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site, writes: int
) -> None:
    place, again = tmp_path / "kitchen.tar", tmp_path / "again.tar"
    await (await made(here)).export(place)
    failing = fail_after(there.nodes, writes)
    next(failing)
    with pytest.raises(ScenefoldError), trio.fail_after(10_000):
        await there.scenes.import_archive("pantry", place)
    next(failing, None)
    scene = await there.scenes.open("pantry")
    assert await scene.space(META).get(LAST_PUT) is None, "what shows the rest comes last"
    with pytest.raises(LocalFault, match=r"exists already.*--resume"):
        await there.scenes.import_archive("pantry", place)
    _, restored = await there.scenes.import_archive("pantry", place, AGAIN)
    assert (restored.reused > 0) == (writes > 0)
    changed = await scene.change_render_settings(partial(replace, samples=9))
    _, third = await there.scenes.import_archive("pantry", place, AGAIN)
    assert third.reused == third.records == restored.records
    assert await scene.render_settings() == changed and changed.settings.camera == "door", (
        "what was said since stays, and nothing is said again"
    )
    await scene.export(again)
    assert files_of(again) == files_of(place)


async def test_what_somebody_else_has_put_there_is_not_harmed(autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site) -> None:
    place = tmp_path / "kitchen.tar"
    await (await made(here)).export(place)
    other = await there.scenes.create("pantry", copies=1)
    taken = Location.from_number(7 << 140)
    await other.space(FILES).put(taken, b"mine")
    with pytest.raises(LocalFault, match="another record lies there than in the archive"):
        await there.scenes.import_archive("pantry", place, AGAIN)
    assert await other.space(FILES).get(taken) == b"mine"
    assert await other.space(META).get(LAST_PUT) is None
    hall = await (await there.scenes.create("larder", copies=1)).create_space("hall", ((0.0,), (1.0,)), copies=1)
    with pytest.raises(LocalFault, match="a space 'hall' of another shape"):
        await there.scenes.import_archive("larder", place, AGAIN)
    assert (await hall.info()).high == (1.0,)


async def test_a_space_that_went_its_own_way_is_no_beginning_of_this_one(
    autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site
) -> None:
    place = tmp_path / "kitchen.tar"
    await (await made(here)).export(place)
    back, _ = await there.scenes.import_archive("pantry", place)
    await (await back.space_named("hall")).scale(2.0)
    with pytest.raises(LocalFault, match="was moved otherwise than in the archive"):
        await there.scenes.import_archive("pantry", place, AGAIN)


async def test_a_dry_run_counts_and_writes_nothing(autojump_clock: MockClock, tmp_path: Path, here: Site) -> None:
    place = tmp_path / "kitchen.tar"
    scene = await made(here)
    report = await scene.export(place, dry_run=True)
    assert (report.listed, report.records, report.spaces["files"], place.exists()) == (FILES_MANY + 10, 0, FILES_MANY + 2, False)
    place.touch()
    with pytest.raises(LocalFault, match="there is a file already"):
        await scene.export(place, dry_run=True)


async def test_an_export_that_fails_leaves_nothing(autojump_clock: MockClock, tmp_path: Path, here: Site) -> None:
    place = tmp_path / "out" / "kitchen.tar"
    place.parent.mkdir()
    scene = await made(here)
    here.nodes.rotten.add(Location.from_number(150 << 140))
    with pytest.raises(ScenefoldError, match="damaged"), trio.fail_after(10_000):
        await scene.export(place)
    assert list(place.parent.iterdir()) == []
    here.nodes.rotten.clear()
    with trio.move_on_after(5.0) as patience:
        await scene.export(place, bytes_per_s=100.0)
    assert patience.cancelled_caught, "a rate bounds it"
    assert list(place.parent.iterdir()) == []


async def test_nothing_is_made_of_a_file_that_is_no_archive(autojump_clock: MockClock, tmp_path: Path, here: Site, there: Site) -> None:
    place = tmp_path / "kitchen.tar"
    await (await made(here)).export(place)
    content = place.read_bytes()
    place.write_bytes(content[: len(content) // 2])
    with pytest.raises(LocalFault, match="no archive of a scene, or a damaged one"):
        await there.scenes.import_archive("pantry", place)
    with pytest.raises(UsageFault, match="how many copies"):
        await there.scenes.import_archive("pantry", place, RestoreOptions(copies_min=1))
    assert await there.scenes.kept_names() == [] and not there.nodes.headers
