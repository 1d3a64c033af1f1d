"""If this fails, who lost an answer is told that a change is in the log or never will be, and it is not so."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from trio.testing import MockClock

from scenectl.errors import UNREACHABLE, ending_of
from scenefold.base.errors import Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Change, InDoubt
from scenefold.client.scene import Scene
from scenefold.client.scene_log import Standing
from scenefold.client.space import Space
from scenefold.peer.scene_log.proposals import rejection
from scenefold.wire import Packet, ProposeSceneLog
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.test_participants import STEP, hall_of, saying
from unit.client.test_spaces import BOX

A, B, C, D, E = FIVE
TOLD = re.compile(r"scene status kitchen ([0-9a-f]{32})@([0-9]+)`")
NEVER_ASKED = bytes(16)


async def lost(council: FakeCouncil, hall: Space) -> tuple[bytes, int, ProposeSceneLog]:
    """A change of which nobody knows what became of it: request, position, proposal."""
    late: list[ProposeSceneLog] = []

    def unknown(address: str, packet: ProposeSceneLog) -> Packet:
        late.append(packet)
        return rejection(RejectReason.NOT_READY, node_id_of(address))

    council.answers = dict.fromkeys(FIVE, unknown)
    with pytest.raises(Unreachable) as told:
        await hall.translate(STEP)
    council.answers.clear()
    found = TOLD.search(told.value.remedy)
    assert found is not None
    return bytes.fromhex(found[1]), int(found[2]), late[0]


async def test_what_is_in_the_log_is_told_with_its_position(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, position, packet = await lost(council, hall)
    council.propose(B, packet)
    await scene.create_space("attic", BOX)
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")
    assert await other.standing(request, position) == await other.standing(request) == Standing(3, True, 4)
    assert (await other.standing(request)).document() == {"outcome": "committed", "position": 3, "known_position": 4}


async def test_never_is_said_once_its_position_is_taken_and_not_before(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, position, _ = await lost(council, hall)
    assert position == 3
    assert await scene.standing(request, position) == Standing(None, False, 2)
    await scene.create_space("attic", BOX)
    assert await scene.standing(request, position) == Standing(None, True, 3)
    assert await scene.standing(request) == Standing(None, False, 3), "where it was offered is not said"
    assert await scene.standing(NEVER_ASKED, 99) == Standing(None, False, 3)


async def test_whoever_is_asked_brings_to_its_end_what_was_begun(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, position, packet = await lost(council, hall)

    def barrier(address: str, asked: ProposeSceneLog) -> Packet:
        assert (asked.private, asked.public) == (b"", council.has[address, scene.id][0].proposed()), "nothing is proposed"
        council.answers.clear()
        council.propose(A, packet)
        return rejection(RejectReason.POSITION_BEHIND, node_id_of(address))

    council.answers = dict.fromkeys(FIVE, barrier)
    assert await scene.standing(request, position) == Standing(3, True, 3)


async def test_without_a_majority_nothing_is_said_of_it(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, position, _ = await lost(council, hall)
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NO_MAJORITY))
    council.away = {A, C}
    with pytest.raises(Unreachable, match=f"nobody can tell now .*no majority .*: 2 of 3 must agree, and {A}, {C} do not answer") as none:
        await scene.standing(request, position)
    assert ending_of(none.value).exit_code == UNREACHABLE, "another code is for what never will be"
    assert "ask again" in none.value.remedy and "nothing was changed" not in none.value.remedy, "that is what nobody knows"
    council.away = set()
    council.answers = dict.fromkeys(FIVE, saying(RejectReason.NOT_READY))
    began = autojump_clock.current_time()
    with pytest.raises(Unreachable, match=r"nobody can tell now .*do not know yet what became of it"):
        await scene.standing(request, position)
    assert autojump_clock.current_time() - began < 60.0


async def test_where_the_origin_decides_alone_its_log_tells(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path, 0)
    known = (await scene.access.read_log()).state
    (request,) = (request for request, position in known.requests.items() if position == 2)
    assert await scene.standing(request, 2) == Standing(2, True, 2)
    await hall.translate(STEP)
    assert await scene.standing(NEVER_ASKED, 3) == Standing(None, True, 3)
    assert await scene.standing(NEVER_ASKED, 4) == Standing(None, False, 3)


async def decided_end(council: FakeCouncil, scene: Scene) -> tuple[bytes, int]:
    """The scene is ended, and whoever ended it was not answered: request and position."""
    late: list[ProposeSceneLog] = []

    def unknown(address: str, packet: ProposeSceneLog) -> Packet:
        late.append(packet)
        return rejection(RejectReason.NOT_READY, node_id_of(address))

    council.answers = dict.fromkeys(FIVE, unknown)
    with pytest.raises(InDoubt) as told:
        await scene.end()
    council.answers.clear()
    council.propose(B, late[0])
    return told.value.request.id, told.value.request.offered_at


async def test_the_end_of_a_scene_is_told_by_its_own_request(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    request, position = await decided_end(council, scene)
    council.without_log = set(FIVE)
    for asked in (scene, await council.scenes(Keyring(tmp_path)).open("kitchen")):
        assert await asked.standing(request, position) == await asked.standing(request) == Standing(3, True, 3)


async def test_other_requests_of_a_scene_that_was_ended_are_told_as_long_as_somebody_has_its_log(
    autojump_clock: MockClock, tmp_path: Path
) -> None:
    council = FakeCouncil()
    scene, hall = await hall_of(council, tmp_path)
    request, position, packet = await lost(council, hall)
    council.propose(B, packet)
    await scene.end()
    for asked in (scene, await council.scenes(Keyring(tmp_path)).open("kitchen")):
        assert await asked.standing(request, position) == Standing(3, True, 4)
        assert await asked.standing(NEVER_ASKED, 3) == Standing(None, True, 4)
    council.without_log = set(FIVE)
    assert await scene.standing(NEVER_ASKED, 4) == Standing(None, True, 4), "the end has that position"
    with pytest.raises(Unreachable, match="the scene was ended at position 4 of its log, and nobody shows the log any more") as told:
        await scene.standing(request, position)
    assert ending_of(told.value).exit_code == UNREACHABLE


async def test_of_a_scene_that_its_origin_has_ended_its_log_tells(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path, 0)
    change = Change()
    await scene.end(again=change)
    assert change.request is not None and change.position == 3
    assert await scene.standing(change.request.id, 3) == Standing(3, True, 3)
    assert await scene.standing(NEVER_ASKED, 3) == Standing(None, True, 3)
