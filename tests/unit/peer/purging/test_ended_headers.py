"""If one fails, a node takes something for a scene that was ended, or takes its end for what it is not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.limits import ENDED_PER_USER_MAX, SCENES_KEPT_MAX, SCENES_LISTED_MAX, SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.records.verification import KnownScene, verified_put
from scenefold.peer.scene_log.headers import checked_header
from scenefold.peer.scene_log.makers import check_maker, check_room, relying_on
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.scene.log import value_of
from scenefold.wire import EndScene, RejectSceneProposal, SceneLogPublic, SceneMode, digest_of_header
from unit.peer.scenes_made import first_header, later_header, offered, sealed
from unit.peer.test_scene_judge import signed
from unit.peer.test_scenes import FIRST as OURS
from unit.peer.test_scenes import ME, USER, Rig, proposal
from unit.scene.log.council import Council
from unit.scene.log.members import grant

FIRST = first_header()
ENDED = later_header(FIRST, position=3, write_floor=3, mode=SceneMode.ENDED)


def test_the_last_header_is_kept_and_nothing_follows_it() -> None:
    known = checked_header(ENDED, checked_header(FIRST, None))
    assert known.is_ended and checked_header(ENDED, None).is_ended
    assert checked_header(ENDED, known).public == ENDED
    for mode in SceneMode:
        with pytest.raises(Refused, match="was ended at position 3") as told:
            checked_header(later_header(ENDED, position=4, write_floor=4, mode=mode), known)
        assert told.value.reason is RejectReason.MODE_FORBIDS
    with pytest.raises(Refused) as behind:
        checked_header(FIRST, known)
    assert behind.value.reason is RejectReason.POSITION_BEHIND


@pytest.mark.parametrize("bent", [{"write_floor": 2}, {"position": 4}], ids=["a floor below it", "behind it"])
def test_an_end_is_at_its_own_position(bent: dict[str, int]) -> None:
    with pytest.raises(Refused, match="position of its last header") as told:
        checked_header(later_header(FIRST, **{"position": 3, "write_floor": 3, **bent}, mode=SceneMode.ENDED), None)
    assert told.value.reason is RejectReason.ILL_FORMED
    with pytest.raises(Refused, match="not at its first one"):
        checked_header(first_header(mode=SceneMode.ENDED, write_floor=1), None)


@pytest.mark.parametrize("epoch", [1, 3])
def test_no_record_is_put_any_more_whenever_it_was_signed(epoch: int) -> None:
    record = sealed(replace(ENDED, position=epoch))
    with pytest.raises(Refused, match="was ended at position 3") as told:
        verified_put(offered(record), KnownScene.of(ENDED))
    assert told.value.reason is RejectReason.MODE_FORBIDS


def test_participants_decide_nothing_behind_it() -> None:
    council = Council()
    council.decide(grant(1))
    offered = council.offer(grant(2))
    council.decide(EndScene())
    ended = council.header
    for mode, floor in ((SceneMode.EDIT, ended.write_floor), (SceneMode.ENDED, ended.position + 1)):
        follows = {"position": ended.position + 1, "previous": digest_of_header(ended), "write_floor": floor, "mode": mode}
        bent = signed(council, replace(offered.header, **follows))  # type: ignore[arg-type]
        assert SceneJudge.of(council.known).refuses(value_of(bent, offered.private, ended)) is RejectReason.MODE_FORBIDS


async def reason_of(rig: Rig, public: SceneLogPublic) -> RejectReason | None:
    reply = await rig.scenes.on_propose(proposal(public), USER)
    return reply.reason if isinstance(reply, RejectSceneProposal) else None


async def test_who_decides_alone_decides_the_end_once_and_nothing_behind_it(autojump_clock: MockClock) -> None:
    rig, ended = Rig(), later_header(OURS, write_floor=2, mode=SceneMode.ENDED)
    assert await reason_of(rig, OURS) is None
    assert await reason_of(rig, ended) is None
    assert await reason_of(rig, ended) is None, "an answer may have been lost"
    assert await reason_of(rig, later_header(OURS)) is RejectReason.POSITION_TAKEN
    assert await reason_of(rig, OURS) is RejectReason.POSITION_BEHIND
    assert await reason_of(rig, later_header(ended, write_floor=3)) is RejectReason.MODE_FORBIDS
    assert [public.mode for public in rig.scenes.all()] == [SceneMode.ENDED], "a genesis is used once"


def known_of(*, is_ended: bool) -> KnownScene:
    return replace(KnownScene.of(first_header(origin=ME)), is_ended=is_ended)


def test_those_that_were_ended_take_room_of_their_own() -> None:
    on, off = known_of(is_ended=False), known_of(is_ended=True)
    check_room([on] * (SCENES_LISTED_MAX - 1) + [off] * 700)
    with pytest.raises(Refused, match=f"{SCENES_LISTED_MAX} scenes already"):
        check_room([on] * SCENES_LISTED_MAX)
    check_room([on] * SCENES_LISTED_MAX, is_ended=True)
    with pytest.raises(Refused, match="with those that were ended"):
        check_room([off] * SCENES_KEPT_MAX, is_ended=True)
    check_maker(on, [on] * (SCENES_PER_USER_MAX - 1) + [off] * (ENDED_PER_USER_MAX - 1), lambda _: True)
    for others in ([on] * SCENES_PER_USER_MAX, [off] * ENDED_PER_USER_MAX):
        with pytest.raises(Refused) as told:
            check_maker(on, others, lambda _: True)
        assert told.value.reason is RejectReason.LIMIT_EXCEEDED


def test_a_node_may_leave_that_decided_nothing_but_ended_scenes() -> None:
    on, off = known_of(is_ended=False), known_of(is_ended=True)
    assert relying_on(ME, [off]) == []
    assert relying_on(ME, [on, off]) == [on.public.scene]
