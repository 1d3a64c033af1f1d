"""If this fails, whoever cancels a change of a scene does not learn that it may have been made, and makes it twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.client import Change, InDoubt
from scenefold.client.ending import end_scene
from scenefold.client.modes import set_mode
from scenefold.client.scene_log import Standing
from scenefold.wire import Packet, ProposeSceneLog, RejectSceneProposal, SceneMode
from scenefold.world import Priority
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_modes import Lenders
from unit.client.test_participants import STEP, hall_of, proposals, saying, where
from unit.client.test_spaces import BOX

PATIENCE_S = 2.0


@dataclass
class Slow(FakeCouncil):
    """`answers_after`: what becomes of a proposal before an answer that never comes."""

    never_answers: Callable[[str, ProposeSceneLog], object] | None = None

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, ProposeSceneLog) and self.never_answers is not None:
            self.never_answers(address, packet)
            await trio.sleep_forever()
        return await super().request(address, priority, packet, timeout)


@pytest.mark.parametrize("is_decided", [True, False])
async def test_a_change_that_was_cancelled_knows_its_request_and_is_made_once(
    autojump_clock: MockClock, tmp_path: Path, is_decided: bool
) -> None:
    council = Slow()
    scene, hall = await hall_of(council, tmp_path)
    change, offered = Change(), list[ProposeSceneLog]()

    def take(address: str, packet: ProposeSceneLog) -> None:
        offered.append(packet)
        if is_decided:
            council.propose(address, packet)

    council.never_answers = take
    with trio.move_on_after(PATIENCE_S):
        await hall.translate(STEP, again=change)
    assert change.is_in_doubt and change.request is not None and change.request.offered_at == 3
    council.never_answers = None
    outcome = await scene.standing(change.request.id, change.request.offered_at)
    assert outcome == (Standing(3, True, 3) if is_decided else Standing(None, False, 2))
    for _ in range(2):
        other = await council.scenes(Keyring(tmp_path)).open("kitchen")
        await (await other.space_named("hall")).translate(STEP, again=change)
        assert change.position == 3 and not change.is_in_doubt
    assert (await where(hall), council.newest(scene.id).position) == (1.0, 3)
    if not is_decided:
        assert isinstance(council.propose(FIVE[0], offered[0]), RejectSceneProposal), "what was offered first has its position taken"


async def test_what_was_answered_in_the_moment_of_the_cancellation_may_have_been_made(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    change = Change()
    with trio.CancelScope() as scope:

        def decide(address: str, packet: ProposeSceneLog) -> None:
            council.answers.clear()
            scope.cancel()

        council.answers = dict.fromkeys(FIVE, decide)
        await hall.translate(STEP, again=change)
    assert scope.cancelled_caught and council.newest(scene.id).position == 3
    assert change.request is not None and change.request.offered_at == 3


async def test_who_is_cancelled_behind_the_answer_knows_where_it_is(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    change = Change()

    async def keep() -> None:
        if council.newest(scene.id).position == 3:
            await trio.sleep_forever()

    monkeypatch.setattr(scene.access.log_or_fault()._memory, "keep", keep)
    with trio.move_on_after(PATIENCE_S):
        await hall.translate(STEP, again=change)
    assert (change.position, change.is_in_doubt) == (3, False)


async def test_what_was_never_offered_is_in_no_doubt(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    change = Change()
    with trio.CancelScope() as scope:
        scope.cancel()
        await hall.translate(STEP, again=change)
    assert scope.cancelled_caught and change.request is None and not proposals(council)[2:]


async def test_what_was_refused_is_a_new_change_the_next_time(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    change = Change()
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NO_MAJORITY))
    with pytest.raises(Refused, match="nothing was changed"):
        await hall.translate(STEP, again=change)
    assert change.request is None and change.position is None
    council.answers.clear()
    await hall.translate(STEP, again=change)
    assert change.position == 3
    await scene.create_space("attic", BOX)
    again = Change(change.request)
    await hall.translate(STEP, again=again)
    assert (again.position, council.newest(scene.id).position, await where(hall)) == (3, 4, 1.0), "not the newest position"


async def test_an_error_and_the_change_name_the_same_request(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, hall = await hall_of(council, tmp_path)
    change = Change()
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NOT_READY))
    with pytest.raises(InDoubt) as told:
        await hall.translate(STEP, again=change)
    assert change.request == told.value.request


async def test_what_is_so_already_has_no_position(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Lenders()
    scene, hall = await hall_of(council, tmp_path)
    change = Change()
    await hall.set_copies(3, 2, again=change)
    await scene.change_render_settings(lambda before: before, again=change)
    await set_mode(scene.access, SceneMode.EDIT, again=change)
    assert change.request is None and change.position is None and council.newest(scene.id).position == 2
    await set_mode(scene.access, SceneMode.RENDER, again=change)
    assert change.position == 3


async def test_of_an_end_that_others_show_the_change_knows_the_position(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = Slow()
    scene, _ = await hall_of(council, tmp_path)
    change = Change()
    council.never_answers = council.propose
    with trio.move_on_after(PATIENCE_S):
        await end_scene(scene.access, again=change)
    assert change.is_in_doubt
    council.never_answers = None
    assert not (await scene.end(again=change)).was_ended and change.position == 3


async def test_a_space_that_was_made_is_described_without_another_question(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    council.away = set(FIVE)
    assert hall.made is not None and (hall.made.id, hall.made.name, hall.made.created) == (hall.id, "hall", 2)
    assert scene.space(hall.id).made is None
