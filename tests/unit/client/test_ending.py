"""If this fails, a scene is ended by who may not, seems to go on when it does not, or is said to have ended when it has not."""

from __future__ import annotations

from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.scene.layout import GEOMETRY
from scenefold.wire import Packet, ProposeSceneLog, Role, SceneMode, SetMode
from unit.client.fake_nodes import FakeNodes
from unit.client.test_grants import Studio, card_of


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def filled(studio: Studio) -> Scene:
    scene = await studio.scenes(1).create("kitchen")
    await scene.space(GEOMETRY).put(FIRST, b"a chair")
    return scene


async def test_an_owner_ends_it_once_and_everybody_is_told(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.WRITER)
    writer = await studio.kitchen(2)
    planned = await scene.end(dry_run=True)
    assert planned.document() == {"id": f"{scene.id:08x}", "ended": False, "position": None, "was_ended": False, "records": 1}
    assert studio.nodes.headers[scene.id].mode is SceneMode.EDIT
    ended = await scene.end()
    assert (ended.position, ended.was_ended) == (3, False)
    for dry_run in (True, False):
        again = await (await studio.kitchen(1)).end(dry_run=dry_run)
        assert (again.position, again.was_ended) == (3, True)
    with pytest.raises(Refused, match="was ended at position 3") as told:
        await writer.space(GEOMETRY).put(FIRST, b"a table")
    assert told.value.reason is RejectReason.MODE_FORBIDS
    for ask in (writer.log, writer.members, writer.spaces):
        with pytest.raises(Refused, match="was ended at position 3"):
            await ask()
    assert await studio.scenes(1).list() == [] and await studio.scenes(2).list() == []
    (listed,) = await studio.scenes(2).list(ended=True)
    assert listed.is_ended and listed.document()["ended"] is True


async def test_its_name_stays_taken_with_its_keys_and_no_gift_is_made_of_it(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.READER)
    await scene.end()
    with pytest.raises(LocalFault, match="which was ended") as told:
        await studio.scenes(1).create("kitchen")
    assert "another name" in told.value.remedy
    with pytest.raises(LocalFault, match="no scene 'kitchen'"):
        await studio.kitchen(2)
    assert (await studio.scenes(1).create("parlour")).id != scene.id


async def test_who_is_no_owner_ends_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.grant(card_of(2), Role.WRITER)
    writer = await studio.kitchen(2)
    for dry_run in (True, False):
        with pytest.raises(LocalFault, match="only an owner"):
            await writer.end(dry_run=dry_run)
    assert studio.nodes.headers[scene.id].mode is SceneMode.EDIT


async def test_it_is_not_ended_while_it_is_rendered(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    for dry_run in (True, False):
        with pytest.raises(Refused, match="render mode") as told:
            await scene.end(dry_run=dry_run)
        assert told.value.remedy.endswith("`scenectl scene mode kitchen edit`")


async def test_a_scene_that_nobody_knows_is_told_so(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await filled(studio)
    other = await studio.kitchen(1)
    del studio.nodes.headers[scene.id]
    with pytest.raises((LocalFault, Refused), match="does not know"):
        await other.end()
    with pytest.raises(LocalFault, match="no scene 'cellar'"):
        await studio.scenes(1).open("cellar")


class Deaf(FakeNodes):
    """They do what they are asked for, and their answer to a proposal is lost."""

    is_lost = False

    def _answer(self, address: str, packet: Packet) -> Packet:
        reply = super()._answer(address, packet)
        if self.is_lost and isinstance(packet, ProposeSceneLog):
            raise Unreachable("the answer was lost", where=address)
        return reply


async def test_an_answer_that_is_lost_is_found_in_the_header(autojump_clock: MockClock, studio: Studio) -> None:
    deaf = Deaf()
    studio.nodes = deaf
    scene = await filled(studio)
    deaf.is_lost = True
    ended = await scene.end()
    assert ended.position == deaf.headers[scene.id].position == 2
