"""If this fails, a node whose disk is an older one decides a position of a scene twice, or cannot decide because somebody is away."""

from __future__ import annotations

import pytest
from trio.testing import MockClock

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.scene_log.first_look import LOOK_S_MAX
from scenefold.wire import AcceptSceneProposal, RejectSceneProposal, RequestSceneLog
from unit.peer.scenes_made import LOG, STRANGER, first_header, later_header
from unit.peer.test_scenes import FIRST, LONGER, OTHER, THIRD, USER, Rig, proposal, second_of

FOURTH = NodeId(4)


def rig_among(*alive: NodeId) -> Rig:
    rig = Rig()
    rig.peers.seem_alive = list(alive)
    return rig


async def reason_of(rig: Rig, packet: object) -> RejectReason | None:
    reply = await rig.scenes.on_propose(packet, USER)  # type: ignore[arg-type]
    return reply.reason if isinstance(reply, RejectSceneProposal) else None


async def test_a_node_that_lost_its_disk_decides_nothing_again_though_one_member_hides_the_scene(autojump_clock: MockClock) -> None:
    rig, second = rig_among(OTHER, THIRD), second_of(FIRST)
    rig.peers.shown = {OTHER: None, THIRD: second}
    assert await reason_of(rig, proposal(FIRST)) is RejectReason.POSITION_BEHIND
    assert rig.scenes.all() == [second]
    third = later_header(second, log=LONGER)
    assert await reason_of(rig, proposal(third, LONGER)) is RejectReason.UNKNOWN_SCENE_OR_SPACE
    assert all(log is None for _, log in rig.store.written)


@pytest.mark.expect_log("has decided position 2 and forgotten it")
async def test_a_node_with_an_older_disk_decides_no_later_position_again(autojump_clock: MockClock) -> None:
    rig, second = rig_among(OTHER, THIRD), second_of(FIRST)
    rig.store.headers_kept = {FIRST.scene: FIRST.encode()}
    rig.store.private[FIRST.scene] = LOG
    await rig.scenes.load()
    rig.peers.shown = {OTHER: FIRST, THIRD: second}
    otherwise = later_header(FIRST, log=b"another log")
    assert await reason_of(rig, proposal(otherwise, b"another log")) is RejectReason.POSITION_TAKEN
    assert rig.scenes.all() == [second]


async def test_nobody_is_asked_twice_and_one_that_is_alone_asks_nobody(autojump_clock: MockClock) -> None:
    rig = rig_among(OTHER, THIRD)
    assert await reason_of(rig, proposal(FIRST)) is None
    assert sorted(member for member, _ in rig.peers.asked) == [OTHER, THIRD]
    assert await reason_of(rig, proposal(second_of(FIRST), LONGER)) is None
    assert len(rig.peers.asked) == 2
    alone = rig_among()
    assert await reason_of(alone, proposal(FIRST)) is None
    assert alone.peers.asked == []


async def test_most_of_those_that_seem_alive_are_enough(autojump_clock: MockClock) -> None:
    rig = rig_among(OTHER, THIRD, FOURTH)
    rig.peers.away = {FOURTH}
    assert await reason_of(rig, proposal(FIRST)) is None
    fewer = rig_among(OTHER, THIRD, FOURTH)
    fewer.peers.away = {THIRD, FOURTH}
    assert await reason_of(fewer, proposal(FIRST)) is RejectReason.NOT_READY
    assert fewer.scenes.all() == []
    fewer.peers.away = {THIRD}
    assert isinstance(await fewer.scenes.on_propose(proposal(FIRST), USER), AcceptSceneProposal)


async def test_the_time_is_bounded_and_who_falls_silent_is_waited_for_no_longer_than_it_seems_alive(autojump_clock: MockClock) -> None:
    rig = rig_among(OTHER)
    rig.peers.away = {OTHER}
    began = autojump_clock.current_time()
    assert await reason_of(rig, proposal(FIRST)) is RejectReason.NOT_READY
    assert autojump_clock.current_time() - began <= LOOK_S_MAX + 0.1
    rig.peers.seem_alive = []
    assert await reason_of(rig, proposal(FIRST)) is None


async def test_what_is_refused_anyway_troubles_nobody(autojump_clock: MockClock) -> None:
    rig = rig_among(OTHER, THIRD)
    nobodys = first_header(STRANGER, origin=NodeId(1), write_floor=1)
    assert await reason_of(rig, proposal(nobodys)) is not None
    assert rig.peers.asked == []


async def test_what_the_node_that_decides_has_lost_is_had_from_others(autojump_clock: MockClock) -> None:
    rig, first = Rig(), first_header(origin=OTHER)
    await rig.scenes.adopt(first)
    rig.peers.shown = {OTHER: first, THIRD: second_of(first)}
    assert (await rig.scenes.known(first.scene, position=2)).public == second_of(first)
    assert [member for member, packet in rig.peers.asked if isinstance(packet, RequestSceneLog)] == [OTHER, THIRD]
