"""If this fails, an owner is told that nothing lies under a key that a revoked member has, while something does, or is never told the end."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.client.former_keys import LOOK_S, FormerKeys
from scenefold.client.progress import ProgressState
from scenefold.client.scene import Scene
from scenefold.scene.layout import GEOMETRY
from scenefold.wire import Packet, Role
from scenefold.world import Priority
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import Studio, card_of
from unit.client.test_reencryption import COUNT, PLACES, filled


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def revoked(studio: Studio) -> Scene:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.READER)
    await scene.grant(card_of(3), Role.READER)
    await scene.revoke("user:ada")
    return scene


async def test_a_scene_whose_key_never_changed_has_nothing_left(autojump_clock: MockClock, studio: Studio) -> None:
    assert await (await filled(studio)).former_keys() is FormerKeys.NONE


@pytest.mark.parametrize("who", [1, 3])
async def test_what_a_killed_re_encryption_left_is_told_until_it_is_done(autojump_clock: MockClock, studio: Studio, who: int) -> None:
    scene = await revoked(studio)
    anybody = await studio.kitchen(who)
    assert await anybody.former_keys() is FormerKeys.SOME, "nobody began"
    with trio.CancelScope() as scope:

        def end(state: ProgressState) -> None:
            if state.done >= COUNT // 2:
                scope.cancel()

        await scene.reencrypt(end)
    assert scope.cancelled_caught
    assert await anybody.former_keys() is FormerKeys.SOME, "it was ended"
    await scene.reencrypt()
    assert await anybody.former_keys() is FormerKeys.NONE


@pytest.mark.parametrize("last", [0, COUNT // 2, COUNT - 1])
async def test_a_single_record_is_found_wherever_it_lies(autojump_clock: MockClock, studio: Studio, last: int) -> None:
    scene = await revoked(studio)
    key = (GEOMETRY, PLACES[last])
    left = studio.nodes.records[key]
    await scene.reencrypt()
    studio.nodes.records[key] = left
    assert await scene.former_keys() is FormerKeys.SOME


async def test_what_is_in_a_space_where_nodes_choose_the_places_counts(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    objects = await scene.create_space("objects", node_managed=True)
    await objects.put_managed(b"a thing")
    await scene.rotate_key()
    assert await scene.former_keys() is FormerKeys.SOME


class Slow(FakeNodes):
    """So slow once told that not all is looked at in time."""

    is_slow = False

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if self.is_slow:
            await trio.sleep(LOOK_S / 4)
        return await super().request(address, priority, packet, timeout)


async def test_what_was_not_looked_at_is_not_called_done(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Slow()
    scene = await revoked(studio)
    await scene.reencrypt()
    nodes.is_slow = True
    begun = trio.current_time()
    assert await scene.former_keys() is FormerKeys.UNKNOWN
    assert trio.current_time() - begun < 2 * LOOK_S
    nodes.is_slow = False
    nodes.away.add("127.0.0.3")
    assert await scene.former_keys() is FormerKeys.UNKNOWN
    nodes.away.clear()
    assert await scene.former_keys() is FormerKeys.NONE
