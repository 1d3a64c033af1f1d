"""If this fails, a node serves who is no member, or turns away a member that it has not heard of yet."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
import trio.testing

from scenefold.base.ids import SceneId
from scenefold.base.limits import CONNECTIONS_PER_PEER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.log_packets import proposal_of
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.enrolment.door import Door
from scenefold.wire import (
    Fault,
    ListScenes,
    LogEntry,
    LogRecord,
    MiniStatus,
    Packet,
    RemoveNode,
    RequestSceneLog,
    RequestTable,
    Want,
    decode_packet,
    encode_frame,
)
from scenefold.wire.enrol_entries import Invite, RevokeUser
from scenefold.world import Priority
from unit.peer import logs_made
from unit.peer.logs_made import add, found, member, node, record
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, card_for, enrolled, invitation_key
from unit.world.test_guests import Line

FACTS = replace(logs_made.facts(2), authority=AUTHORITY.certificate)
ADA = "user:ada"
KEY = NEWCOMERS[0].signing.key_id


def log(*entries: LogEntry) -> Registry:
    registry = Registry()
    for entry in (found(2), add(0), *entries):
        registry = registry.apply(record(registry, entry))
    return registry


STRANGER = log()
INVITED = log(Invite(invitation_key(1).public.raw, ADA, False, int(NOW.timestamp()) + 3600, "user:owner"))
MEMBER = INVITED.apply(record(INVITED, enrolled(1, card_for(ADA, 0))))
REVOKED = MEMBER.apply(record(MEMBER, RevokeUser(ADA, KEY)))


class Log:
    """What the door uses of the cluster's log: `later` is what others know."""

    def __init__(self, registry: Registry, later: Registry) -> None:
        self.registry = registry
        self._later = later
        self.pulls = 0

    async def pull(self) -> None:
        await trio.lowlevel.checkpoint()
        self.pulls += 1
        self.registry = self._later


class Clock:
    stopwatch = None

    def now(self) -> float:
        return trio.current_time()


class World:
    clock = Clock()


class Pool:
    """Of connections to others."""


class Table:
    async def handle(self, packet: Packet, _peer: str) -> Packet:
        await trio.lowlevel.checkpoint()
        return packet


def door(log: Log) -> Door:
    return Door(World(), FACTS, log, Table(), Pool())  # type: ignore[arg-type]


def knocking(number: int) -> Line:
    line = Line(ADA)
    line.peer_key = KEY  # type: ignore[assignment]
    line.feed(encode_frame(ListScenes(request_id=number)))
    return line


async def answer_of(log: Log) -> Packet:
    line = knocking(1)
    line.close()
    await door(log).serve(Priority.LOW, line)  # type: ignore[arg-type]
    return decode_packet(line.answers[0][4:])


async def test_a_member_that_is_newer_than_our_log_is_let_in_once_we_have_asked() -> None:
    log = Log(STRANGER, MEMBER)
    assert isinstance(await answer_of(log), ListScenes) and log.pulls == 1


async def test_a_member_that_we_know_is_let_in_at_once() -> None:
    log = Log(MEMBER, STRANGER)
    assert isinstance(await answer_of(log), ListScenes) and log.pulls == 0


@pytest.mark.expect_log("connection refused")
@pytest.mark.parametrize(
    "known, later, reason",
    [
        (STRANGER, STRANGER, RejectReason.NOT_READY),
        (STRANGER, REVOKED, RejectReason.KEY_REVOKED),
        (REVOKED, MEMBER, RejectReason.KEY_REVOKED),
    ],
)
async def test_who_is_in_no_log_is_told_so(known: Registry, later: Registry, reason: RejectReason) -> None:
    answer = await answer_of(Log(known, later))
    assert isinstance(answer, Fault) and answer.reason == reason


def test_only_member_nodes_have_no_bound_of_their_time() -> None:
    one_door = door(Log(MEMBER, MEMBER))
    assert one_door._is_member(f"node:{node(0)}"), "the first founder took its seat"
    assert not any(one_door._is_member(peer) for peer in (ADA, f"node:{node(1)}", "node:x", ""))


@pytest.mark.expect_log("connection refused")
@pytest.mark.expect_log("its oldest connection is closed")
async def test_who_is_refused_pushes_out_no_connection_of_the_member_whose_name_it_bears() -> None:
    one_door = door(Log(MEMBER, MEMBER))
    async with trio.open_nursery() as nursery:
        member = knocking(1)
        nursery.start_soon(one_door.serve, Priority.LOW, member)
        for _ in range(CONNECTIONS_PER_PEER_MAX + 1):
            thief = knocking(2)
            thief.peer_key = NEWCOMERS[1].signing.key_id  # type: ignore[assignment]
            nursery.start_soon(one_door.serve, Priority.LOW, thief)
        await trio.testing.wait_all_tasks_blocked()
        member.feed(encode_frame(ListScenes(request_id=3)))
        await trio.testing.wait_all_tasks_blocked()
        assert [decode_packet(answer[4:]).request_id for answer in member.answers] == [1, 3]
        nursery.cancel_scope.cancel()


GHOST = f"node:{node(7)}"
CLUSTER_LOG = FACTS.genesis_header.scene


def asked(want: Want, scene: SceneId = CLUSTER_LOG) -> Packet:
    return RequestSceneLog(scene, b"", 0, 0, want)


def proposed(entry: LogEntry) -> Packet:
    return proposal_of(LogRecord(1, bytes(32), bytes(16), node(7), entry), FACTS)


async def answer_to_ghost(log: Log, packet: Packet) -> Packet:
    """What a node hears whose certificate is the authority's, and whose key stands in no log."""
    line = Line(GHOST)
    line.peer_key = KEY  # type: ignore[assignment]
    line.feed(encode_frame(replace(packet, request_id=1)))
    line.close()
    await door(log).serve(Priority.LOW, line)  # type: ignore[arg-type]
    return decode_packet(line.answers[0][4:])


@pytest.mark.parametrize("packet", [asked(Want.LOG), asked(Want.HEADER), proposed(add(7, left_of=0))])
async def test_a_node_that_nobody_knows_may_read_the_clusters_log_and_register(packet: Packet) -> None:
    mini = MiniStatus(1, node(7), None, 0, 0, 0, 0, 0)
    log = Log(STRANGER, STRANGER)
    answer = await answer_to_ghost(log, replace(packet, mini_status=mini))
    assert type(answer) is type(packet) and answer.mini_status is None, "what it says of itself is not taken"
    assert log.pulls == 1


@pytest.mark.parametrize(
    "packet",
    [
        ListScenes(),
        RequestTable(),
        asked(Want.LEASE),
        asked(Want.LOG, SceneId(5)),
        proposed(RemoveNode(member(1), "out")),
        replace(proposed(add(7, left_of=0)), private=b"no record"),  # type: ignore[type-var]
    ],
)
async def test_a_node_that_nobody_knows_may_do_nothing_else(packet: Packet) -> None:
    answer = await answer_to_ghost(Log(STRANGER, STRANGER), packet)
    assert isinstance(answer, Fault) and answer.reason is RejectReason.NOT_AUTHORISED and "no member of this cluster" in answer.text


async def test_a_node_that_registered_elsewhere_is_let_in_once_we_have_asked() -> None:
    line = Line(GHOST)
    line.peer_key = logs_made.key_of(7).public.key_id  # type: ignore[assignment]
    line.feed(encode_frame(ListScenes(request_id=1)))
    line.close()
    await door(Log(STRANGER, log(add(7, left_of=0)))).serve(Priority.LOW, line)  # type: ignore[arg-type]
    assert isinstance(decode_packet(line.answers[0][4:]), ListScenes)


@pytest.mark.expect_log("connection refused")
async def test_nobody_takes_the_name_of_a_node_that_registered_without_a_card() -> None:
    registered = log(add(7, left_of=0))
    answer = await answer_to_ghost(Log(registered, registered), ListScenes())
    assert isinstance(answer, Fault) and answer.reason is RejectReason.NOT_READY
