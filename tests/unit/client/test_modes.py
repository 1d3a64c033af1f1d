"""If this fails, somebody is told that a mode is active which is not, or is never told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenectl.errors import REFUSED, ending_of
from scenectl.modes import mode_text, so_already_text
from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.client import Change, InDoubt, modes
from scenefold.client.log_reading import ReadLog
from scenefold.client.modes import ACTIVE_S_MAX, LOOK_S, ModeShown, mode_of, set_mode
from scenefold.scene.log import SceneLog
from scenefold.wire import BorrowLease, LeaseUse, LentLease, LogEntry, Packet, SceneLogPublic, SceneMode, SetMode
from scenefold.world import Priority
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import STEP, hall_of
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
    already: list[int | None] = []
    shown = await set_mode(scene.access, SceneMode.RENDER, decided.append, already.append)
    assert decided == [before + 1] and already == [] and shown == ModeShown(before + 1, SceneMode.RENDER, True)
    assert await set_mode(scene.access, SceneMode.RENDER, decided.append, already.append) == shown, "it is so already"
    assert decided == [before + 1] and already == [before + 1]


async def test_a_minority_does_not_know(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    council.without_lease = set(FIVE)
    shown = await mode_of(scene.access)
    assert shown.is_active is None and "unknown" in mode_text(shown)


async def test_what_is_so_already_is_not_called_decided(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, hall = await hall_of(council, tmp_path)
    decided: list[int] = []
    already: list[int | None] = []
    await set_mode(scene.access, SceneMode.EDIT, decided.append, already.append)
    await set_mode(scene.access, SceneMode.RENDER)
    await set_mode(scene.access, SceneMode.EDIT)
    since = council.newest(scene.id).position
    await hall.translate(STEP)
    await set_mode(scene.access, SceneMode.EDIT, decided.append, already.append)
    assert decided == [] and already == [1, since], "the entry that brought it, and no other one"
    assert "since position" in so_already_text("edit", since) and "since" not in so_already_text("edit", None)


async def test_a_minority_that_has_it_so_confirms_nothing(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    council.without_lease = set(FIVE)
    told: list[int | None] = []
    began = trio.current_time()
    shown = await set_mode(scene.access, SceneMode.EDIT, told.append, told.append)
    assert shown.is_active is None and told == [] and "No majority confirms it" in mode_text(shown)
    assert trio.current_time() - began < ACTIVE_S_MAX / 2


async def test_who_is_overtaken_by_another_owner_is_told_so(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    council.looks = 6
    scene, _ = await hall_of(council, tmp_path)
    ended: list[Refused] = []

    async def render() -> None:
        with pytest.raises(Refused, match="the scene was switched to edit mode since") as refused:
            await set_mode(scene.access, SceneMode.RENDER)
        ended.append(refused.value)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(render)
        await trio.sleep(LOOK_S * 1.5)
        again = council.newest(scene.id).position + 1
        await scene.access.change_log(lambda _: SetMode(SceneMode.EDIT))
    ending = ending_of(ended[0])
    assert ending.exit_code == REFUSED and f"position {again} " in ending.line and "scene log" in ending.line


async def test_who_was_not_the_first_to_switch_has_decided_nothing(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    old = council.newest(scene.id)

    async def late(_: object) -> SceneLogPublic:
        return old

    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    monkeypatch.setattr(modes, "_header", late)
    told: list[int | None] = []
    shown = await set_mode(scene.access, SceneMode.RENDER, lambda _: pytest.fail("decided"), told.append)
    assert shown.is_active and told == [old.position + 1]


async def test_what_is_called_decided_is_the_entry_that_switched_and_no_later_one(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The answer to it was lost, say, and by the time that it is found in the log somebody else has switched back."""
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    change, ours = scene.access.change_log, council.newest(scene.id).position + 1

    async def overtaken(entry_of: Callable[[SceneLog], LogEntry], *, again: None, forced: bool = False) -> ReadLog:
        await change(entry_of, again=again, forced=forced)
        await change(lambda _: SetMode(SceneMode.EDIT))
        return await scene.access.read_log()

    monkeypatch.setattr(scene.access, "change_log", overtaken)
    decided: list[int] = []
    with pytest.raises(Refused, match="the scene was switched to edit mode since"):
        await set_mode(scene.access, SceneMode.RENDER, decided.append)
    assert decided == [ours]


async def test_a_scene_that_was_ended_is_in_no_mode_and_that_is_said(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")
    await scene.end()
    for mode in (None, SceneMode.RENDER, SceneMode.EDIT):
        with pytest.raises(Refused, match="the scene was ended at position 3 of its log") as told:
            await (mode_of(other.access) if mode is None else set_mode(other.access, mode))
        assert told.value.reason is RejectReason.MODE_FORBIDS


async def test_who_ends_it_while_a_mode_becomes_active_ends_the_wait(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    council.looks = 1_000
    scene, _ = await hall_of(council, tmp_path)
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")

    async def end() -> None:
        await trio.sleep(LOOK_S * 1.5)
        await other.access.change_log(lambda _: SetMode(SceneMode.EDIT))
        await other.end()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(end)
        with pytest.raises(Refused, match=r"was ended at position 5|switched to edit mode since"):
            await set_mode(scene.access, SceneMode.RENDER)


async def test_a_switch_in_doubt_is_not_refused_because_the_scene_was_ended(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, _ = await hall_of(council, tmp_path)
    change = Change()
    await set_mode(scene.access, SceneMode.RENDER, again=change)
    await set_mode(scene.access, SceneMode.EDIT)
    await scene.end()
    with pytest.raises(InDoubt, match="the scene was ended"):
        await set_mode(scene.access, SceneMode.RENDER, again=change.request)


@pytest.mark.parametrize("is_active, words", [(True, "which is active"), (False, "not active yet"), (None, "unknown")])
def test_in_words(is_active: bool | None, words: str) -> None:
    shown = ModeShown(4, SceneMode.RENDER, is_active)
    assert words in mode_text(shown) and "render mode" in mode_text(shown)
    assert shown.document() == {"position": 4, "mode": "render", "active": is_active}
