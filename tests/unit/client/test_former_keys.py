"""If this fails, an owner is told that nothing lies under a key that a revoked member has, while something does, or is never told the end."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.client.former_keys import LOOK_S, FormerKeys
from scenefold.client.progress import ProgressState
from scenefold.client.scene import Scene
from scenefold.scene.layout import FILES, GEOMETRY, SPACES
from scenefold.wire import Packet, QueryRange, Role
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


@pytest.mark.parametrize("long", [COUNT, COUNT - 1])
@pytest.mark.parametrize("last", [0, COUNT // 2, COUNT - 1])
async def test_a_single_record_is_found_wherever_it_lies(
    autojump_clock: MockClock, studio: Studio, monkeypatch: pytest.MonkeyPatch, last: int, long: int
) -> None:
    """In a space that is listed whole, and in one that is long and listed in pieces."""
    monkeypatch.setattr("scenefold.client.former_keys.LONG", long)
    scene = await revoked(studio)
    key = (GEOMETRY, PLACES[last])
    left = studio.nodes.records[key]
    await scene.reencrypt()
    studio.nodes.records[key] = left
    assert await scene.former_keys() is FormerKeys.SOME
    await scene.reencrypt()
    assert await scene.former_keys() is FormerKeys.NONE


async def test_what_is_in_a_space_where_nodes_choose_the_places_counts(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await studio.scenes(1).create("kitchen")
    objects = await scene.create_space("objects", node_managed=True)
    await objects.put_managed(b"a thing")
    await scene.rotate_key()
    assert await scene.former_keys() is FormerKeys.SOME


class Slow(FakeNodes):
    """Each answer takes a while."""

    answer_s = 0.0
    deaf_to: int | None = None
    """Of this space nobody tells anything."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        await trio.sleep(self.answer_s)
        if isinstance(packet, QueryRange) and packet.space == self.deaf_to:
            raise Unreachable("it does not answer", where=address)
        return await super().request(address, priority, packet, timeout)


async def test_a_scene_of_many_short_spaces_is_looked_through_in_few_questions_and_some_at_once(
    autojump_clock: MockClock, studio: Studio
) -> None:
    """A busy node takes a tenth of a second for each."""
    studio.nodes = nodes = Slow()
    scene = await revoked(studio)
    await scene.reencrypt()
    nodes.answer_s, nodes.asked = 0.1, []
    begun = trio.current_time()
    assert await scene.former_keys() is FormerKeys.NONE
    ranges = sum(isinstance(packet, QueryRange) for _, packet in nodes.asked)
    assert ranges == len(SPACES) * len(nodes.addresses)
    assert trio.current_time() - begun < 0.1 * ranges * 0.6, "some were asked at once"


async def test_who_does_not_tell_of_one_space_hides_nothing_in_another(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Slow()
    scene = await revoked(studio)
    nodes.deaf_to = FILES
    assert await scene.former_keys(600.0) is FormerKeys.SOME
    nodes.deaf_to = None
    await scene.reencrypt()
    nodes.deaf_to = FILES
    assert await scene.former_keys(600.0) is FormerKeys.UNKNOWN


async def test_what_was_not_looked_at_is_not_called_done(autojump_clock: MockClock, studio: Studio) -> None:
    studio.nodes = nodes = Slow()
    scene = await revoked(studio)
    await scene.reencrypt()
    nodes.answer_s = LOOK_S / 4
    begun = trio.current_time()
    assert await scene.former_keys() is FormerKeys.UNKNOWN
    assert trio.current_time() - begun < 2 * LOOK_S
    assert await scene.former_keys(600.0) is FormerKeys.NONE, "whoever has the time is told"
    nodes.answer_s = 0.0
    nodes.away.add("127.0.0.3")
    assert await scene.former_keys() is FormerKeys.UNKNOWN
    nodes.away.clear()
    assert await scene.former_keys() is FormerKeys.NONE
