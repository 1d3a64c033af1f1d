"""If this fails, somebody is told that a mode is active which is not, or is never told."""

from __future__ import annotations

from pathlib import Path

import pytest
from trio.testing import MockClock

from scenectl.modes import mode_text
from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.client.modes import ModeShown, mode_of, set_mode
from scenefold.wire import BorrowLease, LeaseUse, LentLease, Packet, SceneMode
from scenefold.world import Priority
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import hall_of
from unit.client.test_spaces import scene_of


class Lenders(FakeCouncil):
    """Participants that have a lease, or say why not; a mode is active once they were asked so often."""

    looks = 2

    async def request(self, address: str, priority: Priority, packet: Packet, timeout_s: float) -> Packet:
        if not isinstance(packet, BorrowLease):
            return await super().request(address, priority, packet, timeout_s)
        assert packet.use is LeaseUse.LOOK and not packet.signature
        if address in self.without_lease:
            raise Refused(RejectReason.MODE_FORBIDS, "the mode is unknown", where=address)
        header = self.newest(packet.scene)
        self.looks -= 1
        return LentLease(packet.nonce, header.participants[0].member.node, header.position, header.mode, self.looks < 0)


async def test_where_the_origin_decides_alone_a_mode_is_active_at_once(autojump_clock: MockClock, tmp_path: Path) -> None:
    from unit.client.fake_nodes import FakeNodes

    scene = await scene_of(FakeNodes(), tmp_path)
    assert await mode_of(scene.access) == ModeShown(1, SceneMode.EDIT, True)
    assert await set_mode(scene.access, SceneMode.RENDER) == ModeShown(2, SceneMode.RENDER, True)


async def test_decided_and_then_active(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    before = (await mode_of(scene.access)).position
    decided: list[int] = []
    shown = await set_mode(scene.access, SceneMode.RENDER, decided.append)
    assert decided == [before + 1] and shown == ModeShown(before + 1, SceneMode.RENDER, True)
    assert await set_mode(scene.access, SceneMode.RENDER) == shown, "it is so already"


async def test_a_minority_does_not_know(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    council.without_lease = set(FIVE)
    shown = await mode_of(scene.access)
    assert shown.is_active is None and "unknown" in mode_text(shown)


@pytest.mark.parametrize("is_active, words", [(True, "which is active"), (False, "not active yet"), (None, "unknown")])
def test_in_words(is_active: bool | None, words: str) -> None:
    shown = ModeShown(4, SceneMode.RENDER, is_active)
    assert words in mode_text(shown) and "render mode" in mode_text(shown)
    assert shown.document() == {"position": 4, "mode": "render", "active": is_active}
