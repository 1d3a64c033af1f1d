"""If this fails, a scene that has changed often is lost to those who use it, or shows its content somewhere else than it lies."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from trio.testing import MockClock

from scenectl.scene_log import log_text
from scenefold.base.errors import DamagedData
from scenefold.base.ids import node_id_of
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.wire import TranslateSpace
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import hall_of

STEP = (1.0, 0.25, -0.5)
MOVES = 16


@pytest.fixture(autouse=True)
def short_tails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Snapshots are made of few records already."""
    monkeypatch.setattr("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_MAX", 6)
    monkeypatch.setattr("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_KEPT", 2)


async def reader_of(council: FakeCouncil, folder: Path) -> tuple[Scene, Space]:
    """Somebody who has read nothing yet."""
    scene = await council.scenes(Keyring(folder)).open("kitchen")
    return scene, await scene.space_named("hall")


async def position_of(scene: Scene) -> int:
    return (await scene.access.read_log()).state.position


@pytest.mark.parametrize("participants", [0, 3])
async def test_a_scene_of_many_changes_is_what_it_was(autojump_clock: MockClock, tmp_path: Path, participants: int) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, participants)
    _, their_hall = await reader_of(council, tmp_path)
    places, sizes = {}, []
    for index in range(MOVES):
        if index % 5 == 0:
            # Where it lies then, and from where it is carried on.
            point = tuple((np.array([1.0, 2.0, 3.0]) + np.array(STEP) * index).tolist())
            ((place),) = await hall.put_all_at([(point, b"%d" % index)])
            places[place] = await position_of(scene)
        await hall.translate(STEP)
        sizes.append(len(_private(council, scene)))
        if index % 2:
            # One that looks now and then, and one that reads from the snapshot on.
            assert (await their_hall.info()).transform == (await hall.info()).transform
        opened, newly = await reader_of(council, tmp_path)
        log = (await opened.access.read_log()).log
        assert len(log.records) <= 6 and (log.snapshot is not None) == (log.state.position > 6)
        assert (await newly.info()).document() == (await hall.info()).document()
    assert max(sizes[6:]) < sizes[3] + MOVES * 60, "each further move adds its request and its step, no more"
    assert (await hall.info()).transform.offset == tuple(part * MOVES for part in STEP)
    low, high = ([corner + part * MOVES - 0.5 for corner, part in zip(point, STEP, strict=True)] for point in ((1, 2, 3), (2, 3, 4)))
    _, newly = await reader_of(council, tmp_path)
    for reader in (hall, their_hall, newly):
        assert {found.location async for found in reader.query_box(low, high)} >= set(places)
    for written_at in places.values():
        was = (await newly.info()).transform_until(written_at).apply(np.zeros(3))
        np.testing.assert_array_equal(
            (await newly.info()).fast_forward([was], written_at)[0], (await hall.info()).transform.apply(np.zeros(3))
        )


def _private(council: FakeCouncil, scene: Scene) -> bytes:
    """The sealed log as somebody who decides keeps it."""
    newest = council.newest(scene.id) if any(of == scene.id for _, of in council.has) else None
    if newest is not None and newest.participants:
        return next(private for (_, of), (header, private) in council.has.items() if of == scene.id and header == newest)
    return council.logs[scene.id]


async def test_the_log_of_a_long_scene_tells_what_is_left(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    for _ in range(9):
        await hall.translate(STEP)
    await scene.remove_participant(node_id_of(FIVE[1]))
    story = await scene.log()
    assert story.position == 12 and story.before == 12 - len(story.entries) > 0
    assert [entry.position for entry in story.entries] == list(range(story.before + 1, 13))
    assert all(entry.vouched is not None for entry in story.entries)
    assert isinstance(story.entries[0].record.entry, TranslateSpace)
    assert str(story.before) in log_text(story)


async def test_nobody_is_told_another_past_than_he_has_read(autojump_clock: MockClock, tmp_path: Path) -> None:
    """As after every node lost the log, and owners made another one."""
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path / "one", 0)
    shutil.copytree(tmp_path / "one", tmp_path / "another")
    reader, _ = await reader_of(council, tmp_path / "one")
    header, private = council.headers[scene.id], council.logs[scene.id]
    await hall.translate(STEP)
    assert await position_of(reader) == 3
    council.headers[scene.id], council.logs[scene.id] = header, private
    council.tell(header, private)
    other, their_hall = await reader_of(council, tmp_path / "another")
    for _ in range(9):
        await their_hall.translate((5.0, 0.0, 0.0))
    with pytest.raises(DamagedData, match="tells otherwise of space 31 than what was read up to position 3"):
        await position_of(reader)
    assert await position_of(other) == 11
