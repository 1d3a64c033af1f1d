"""If this fails, one node can lead a client back to a state of a scene in which a former member still had its key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.client.sealing import SceneIdentity
from scenefold.crypto import RecordHeader
from scenefold.scene.layout import GEOMETRY
from scenefold.wire import Packet, RequestSceneLog, RespondSceneLog, Role, SceneLogPublic
from scenefold.world import Priority
from unit.client.test_grants import PLACES, Studio, card_of


class Liars:
    """Nodes of a studio that show another header than they have. None: they say that they know none."""

    def __init__(self, studio: Studio, shown: dict[str, SceneLogPublic | None]) -> None:
        self._honest = studio.nodes.request
        self._shown = shown
        studio.nodes.request = self.request  # type: ignore[method-assign]

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        reply = await self._honest(address, priority, packet, timeout)
        if address in self._shown and isinstance(packet, RequestSceneLog) and isinstance(reply, RespondSceneLog) and reply.answer:
            header = self._shown[address]
            return RespondSceneLog(None if header is None else replace(reply.answer, public=header))
        return reply


async def revoked(studio: Studio) -> tuple[SceneLogPublic, SceneLogPublic]:
    """The headers of before and after the revocation of Ada, an owner."""
    scene = await studio.scenes(1).create("kitchen")
    await scene.grant(card_of(3), Role.WRITER)
    await scene.grant(card_of(2), Role.OWNER)
    (before,) = studio.nodes.headers.values()
    await scene.revoke("user:ada")
    return before, studio.nodes.headers[before.scene]


async def test_what_was_met_in_an_earlier_process_is_not_taken_back(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    before, after = await revoked(studio)
    studio.nodes.headers[before.scene] = before
    with pytest.raises(Refused, match="only older headers"):
        await studio.kitchen(1)
    studio.nodes.headers[before.scene] = after
    scene = await studio.kitchen(1)
    await scene.space(GEOMETRY).put(PLACES[0], b"of after the revocation")
    (item,) = studio.nodes.records.values()
    assert RecordHeader.decode(item.header).key_epoch == 1


async def test_what_was_met_while_the_scene_was_open_is_kept_too(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    owner = await studio.scenes(1).create("kitchen")
    await owner.grant(card_of(3), Role.WRITER)
    ben = await studio.kitchen(3)
    (before,) = studio.nodes.headers.values()
    await owner.rotate_key()
    await ben.space(GEOMETRY).put(PLACES[0], b"refused under the old key, and sealed anew")
    studio.nodes.headers[before.scene] = before
    with pytest.raises(Refused, match="only older headers"):
        await studio.kitchen(3)


@pytest.mark.parametrize("liar", ["127.0.0.2", "127.0.0.3", "127.0.0.4"])
@pytest.mark.parametrize("lie", ["older", "forged", "unknown"])
async def test_one_node_that_lies_speaks_for_nobody_else(lie: str, liar: str, autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    before, after = await revoked(studio)
    shown = {"older": before, "forged": replace(after, position=after.position + 1), "unknown": None}[lie]
    Liars(studio, {liar: shown})
    for number in (1, 3):
        scene = await studio.kitchen(number)
        identity: SceneIdentity = scene.access.identity
        assert (identity.position, identity.key_epoch) == (after.position, 1)


async def test_who_opens_a_scene_for_the_first_time_takes_the_newest_of_what_is_shown(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    before, after = await revoked(studio)
    Liars(studio, dict.fromkeys([address_of(after.origin), "127.0.0.3"], before))
    assert (await studio.kitchen(3)).access.identity.position == after.position


async def test_if_all_lie_that_is_told(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    _, after = await revoked(studio)
    Liars(studio, dict.fromkeys(studio.nodes.addresses, replace(after, position=after.position + 1)))
    with pytest.raises(DamagedData):
        await studio.kitchen(1)


async def test_a_scene_that_was_met_is_not_made_anew_if_nobody_knows_it(autojump_clock: MockClock, tmp_path: Path) -> None:
    studio = Studio(tmp_path)
    await revoked(studio)
    studio.nodes.headers.clear()
    scenes = studio.scenes(1)
    for again in (scenes.create, scenes.open_or_create, scenes.open):
        with pytest.raises(LocalFault, match="does not know this scene"):
            await again("kitchen")


async def test_the_log_as_it_was_read_before_is_not_taken_once_a_newer_header_was_met(autojump_clock: MockClock, tmp_path: Path) -> None:
    """Else its keeper could have the keys of now sealed to whom only the log of before grants the scene."""
    studio = Studio(tmp_path)
    owner = await studio.scenes(1).create("kitchen")
    await owner.grant(card_of(2), Role.OWNER)
    await owner.grant(card_of(3), Role.WRITER)
    await owner.access.read_log()
    (before,) = studio.nodes.headers.values()
    await (await studio.kitchen(2)).revoke("user:ben")
    await owner.access.refresh()
    assert owner.access.identity.position > before.position
    Liars(studio, {address_of(before.origin): before})
    with pytest.raises(Unreachable, match="has an older one, or another one"):
        await owner.access.read_log()
