"""If one fails, copies are called corrupt whose writer came later, or nobody without a scene's key can prove its copies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.proof import Proof
from scenefold.client.proving import Proving
from scenefold.client.proving_reads import NodeReads
from scenefold.client.proving_scenes import ShownScene, shown_scenes
from scenefold.client.reencryption import Pace
from scenefold.wire import RequestSceneLog
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import ITEMS
from unit.client.test_scenes import OTHER, _scenes

FILES = SpaceId(10)


async def proved(nodes: FakeNodes, shown: list[ShownScene]) -> Proof:
    calls = nodes.calls()
    return await Proving(calls, shown, NodeReads(calls, Pace(None))).run()


async def test_whoever_sees_the_header_proves_and_whoever_has_the_key_opens_as_well(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    mine = _scenes(nodes, tmp_path / "mine")
    scene = await mine.create("kitchen", copies=1)
    await scene.space(FILES).put_many(ITEMS)
    stranger = _scenes(nodes, tmp_path / "other", OTHER)
    await stranger.create("hall", copies=1)
    by_me = await shown_scenes(nodes.calls(), mine, None)
    by_stranger = await shown_scenes(nodes.calls(), stranger, f"{scene.id:08x}")
    assert {one.name: one.keys is not None for one in by_me} == {"kitchen": True, f"{(await stranger.open('hall')).id:08x}": False}
    assert [(one.name, one.keys) for one in by_stranger] == [(f"{scene.id:08x}", None)]
    # These nodes keep all scenes' records in one heap.
    for shown, opened in (([one for one in by_me if one.keys], len(ITEMS)), (by_stranger, 0)):
        proof = await proved(nodes, shown)
        assert (proof.is_sound, proof.records, proof.opened) == (True, len(ITEMS), opened)
    with pytest.raises(LocalFault, match="no such scene"):
        await shown_scenes(nodes.calls(), stranger, "kitchen")


async def test_a_header_that_is_too_old_is_followed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await _scenes(nodes, tmp_path).create("kitchen", copies=1)
    await scene.space(FILES).put_many(ITEMS[:10])
    old = ShownScene.of(nodes.headers[scene.id])
    await scene.rotate_key()
    await scene.space(FILES).put_many(ITEMS[10:])
    assert (await proved(nodes, [old])).is_sound
    # Of a record that nobody could have written the header is asked for, and does not help.
    place = Location.from_number(ITEMS[0][0].number + 1)
    nodes.records[FILES, place] = replace(nodes.records[FILES, ITEMS[0][0]], location=place)
    nodes.asked.clear()
    stranger = replace(old, writers={})
    proof = await proved(nodes, [stranger])
    assert (proof.corrupt, proof.records) == (1, len(ITEMS) + 1)
    assert any(isinstance(packet, RequestSceneLog) for _, packet in nodes.asked)


async def test_a_header_of_another_scene_is_not_followed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await _scenes(nodes, tmp_path).create("kitchen", copies=1)
    await scene.space(FILES).put_many(ITEMS)
    old = replace(ShownScene.of(nodes.headers[scene.id]), writers={})
    other = FakeNodes()
    hall = await _scenes(other, tmp_path / "other", OTHER).create("hall", copies=1)
    header = other.headers[hall.id]
    nodes.headers[scene.id] = replace(header, scene=scene.id, position=9)
    proof = await proved(nodes, [old])
    assert (proof.corrupt, proof.lost) == (len(ITEMS), len(ITEMS))
