"""If this fails, a scene exists whose keys nobody has, or a name leads to the wrong scene."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason
from scenefold.client.scenes import Scenes
from scenefold.crypto import SigningKey
from scenefold.peer.scene_log.proposals import rejection
from scenefold.simulation.clients import secrets_of
from scenefold.wire import ProposeSceneLog
from scenefold.world import offline_world
from scenefold.world.keyring import Keyring
from unit.client.fake_nodes import ORIGIN, FakeNodes

WRITER = SigningKey(bytes(31) + b"\1")
OTHER = SigningKey(bytes(31) + b"\7")


def _scenes(nodes: FakeNodes, folder: Path, writer: SigningKey = WRITER) -> Scenes:
    return Scenes(nodes.calls(), Keyring(folder), secrets_of(writer), ORIGIN)


async def test_a_scene_is_made_opened_and_listed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    made = await _scenes(nodes, tmp_path).create("kitchen")
    opened = await _scenes(nodes, tmp_path).open("kitchen")
    assert (opened.id, opened.genesis) == (made.id, made.genesis)
    await _scenes(nodes, tmp_path / "other", OTHER).create("hall")
    listed = await _scenes(nodes, tmp_path).list()
    assert [(scene.name, scene.has_key) for scene in listed] == [("kitchen", True), (None, False)]
    assert not (await opened.info()).document()["has_content"]


async def test_keys_are_on_disk_before_a_node_hears_of_the_scene(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes(away={"127.0.0.2", "127.0.0.3", "127.0.0.4"})
    with pytest.raises(Unreachable):
        await _scenes(nodes, tmp_path).create("kitchen")
    keys = Keyring(tmp_path).load("kitchen")
    nodes.away.clear()
    with pytest.raises(LocalFault, match="does not know"):
        await _scenes(nodes, tmp_path).open("kitchen")
    assert (await _scenes(nodes, tmp_path).create("kitchen")).genesis == keys.genesis


async def test_a_scene_has_the_copies_that_it_was_made_with_also_if_that_was_interrupted(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes(away={"127.0.0.2", "127.0.0.3", "127.0.0.4"})
    with pytest.raises(Unreachable):
        await _scenes(nodes, tmp_path).create("kitchen", copies=2, copies_min=1)
    nodes.away.clear()
    with pytest.raises(LocalFault, match="with 2 copies, 1 of them needed, was interrupted"):
        await _scenes(nodes, tmp_path).create("kitchen", copies=2)
    with pytest.raises(UsageFault, match="1 to 8 copies"):
        await _scenes(nodes, tmp_path).create("kitchen", copies=9)
    scene = await _scenes(nodes, tmp_path).open_or_create("kitchen")
    assert {(space.copies, space.copies_min) for space in await scene.spaces() if not space.parent} == {(2, 1)}
    plain = await _scenes(nodes, tmp_path).open_or_create("hall", copies=1)
    assert {(space.copies, space.copies_min, space.parent) for space in await plain.spaces()} == {(1, 1, 0)}


async def test_a_name_is_given_once(autojump_clock: MockClock, tmp_path: Path) -> None:
    scenes = _scenes(FakeNodes(), tmp_path)
    await scenes.create("kitchen")
    with pytest.raises(LocalFault, match="exists already"):
        await scenes.create("kitchen")
    assert (await scenes.open_or_create("kitchen")).name == "kitchen"
    with pytest.raises(LocalFault, match="cannot be the name"):
        await scenes.create("../kitchen")
    with pytest.raises(LocalFault, match="no scene"):
        await scenes.open("attic")


class BlockedKeyring(Keyring):
    """One that is on a disk that hangs: only a worker thread may touch it."""

    def _path(self, name: str) -> Path:
        assert threading.current_thread() is not threading.main_thread()
        return super()._path(name)

    def names(self) -> list[str]:
        assert threading.current_thread() is not threading.main_thread()
        return super().names()


async def test_the_keyring_is_never_read_on_trios_thread(tmp_path: Path) -> None:
    nodes = FakeNodes()
    calls = nodes.calls()
    calls.world = replace(calls.world, workers=offline_world().workers)
    scenes = Scenes(calls, BlockedKeyring(tmp_path), secrets_of(WRITER), ORIGIN)
    await scenes.create("kitchen")
    await scenes.open("kitchen")
    await scenes.open_or_create("kitchen")
    assert [scene.name for scene in await scenes.list()] == ["kitchen"]


async def test_a_forged_header_is_not_believed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    made = await _scenes(nodes, tmp_path).create("kitchen")
    other = await _scenes(nodes, tmp_path).create("hall")
    nodes.headers[made.id] = nodes.headers[other.id]
    with pytest.raises(DamagedData, match="another scene"):
        await _scenes(nodes, tmp_path).open("kitchen")


async def test_another_user_of_the_profile_cannot_announce_it_anew(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    await _scenes(nodes, tmp_path).create("kitchen")
    nodes.headers.clear()
    with pytest.raises(LocalFault, match="another user"):
        await _scenes(nodes, tmp_path, OTHER).create("kitchen")
    assert sum(isinstance(packet, ProposeSceneLog) for _, packet in nodes.asked) == 1


def test_what_connect_comes_with_does_not_hide_it() -> None:
    import scenefold
    from scenefold.client import profile_folder

    assert callable(scenefold.connect) and callable(profile_folder)
    assert callable(scenefold.client.connect)


async def test_who_has_made_too_many_scenes_is_told_so(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    nodes._propose = lambda packet: rejection(RejectReason.LIMIT_EXCEEDED, ORIGIN.node)  # type: ignore[method-assign]
    with pytest.raises(Refused, match="no more scenes: 128 of one user, 512 in all"):
        await _scenes(nodes, tmp_path).create("kitchen")
    assert Keyring(tmp_path).names() == []
