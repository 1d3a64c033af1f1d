"""If this fails, a log on a node asks those who are gone, or whoever has no say in it keeps its node busy."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.errors import LocalFault, NotReached, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.consensus import AskLog, Learn, Propose, Value
from scenefold.consensus.packets import packet_of, pages_of
from scenefold.peer.logs import Logs
from scenefold.peer.logs.intake import ASKING_COUNTS, STRANGERS_BURST, Intake
from scenefold.peer.logs.links import LOOK_S, NodePorts
from scenefold.wire import Ballot, Packet, Phase, ProposalId, RequestSceneLog, RespondSceneLog, Want
from scenefold.world import Priority
from unit.consensus.logs_made import GENESIS, member
from unit.peer.logs.test_parts import learn

ME, ONE, TWO, STRANGER = NodeId(9), NodeId(1), NodeId(2), NodeId(3)
GONE = b"g" * 16


class Clock:
    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        return self.time


class Heard:
    """A log that remembers what it is given."""

    def __init__(self, genesis: bytes = GENESIS) -> None:
        self.genesis, self.position = genesis, 7
        self.judge = SimpleNamespace(participants=SimpleNamespace(nodes=frozenset({ONE, TWO})))
        self.received: list[tuple[NodeId, Any]] = []
        self.lost_nodes: list[NodeId] = []

    def receive(self, sender: NodeId, message: Any) -> None:
        self.received.append((sender, message))

    def lost(self, node: NodeId) -> None:
        self.lost_nodes.append(node)


class Post:
    """Other nodes."""

    def __init__(self) -> None:
        self.told: list[tuple[NodeId, Packet]] = []
        self.problem: Exception | None = None

    async def tell(self, member: NodeId, priority: Priority, packet: Packet, timeout: float, *, while_it_moves: bool) -> None:
        await trio.lowlevel.checkpoint()
        if self.problem is not None:
            raise self.problem
        assert priority is Priority.HIGH and while_it_moves
        self.told.append((member, packet))


def ports_of(clock: Clock, post: Post, alive: list[NodeId]) -> tuple[NodePorts, Any]:
    links = SimpleNamespace(on_lost=None)
    routing, roster = (
        SimpleNamespace(members=(ONE, ME, TWO)),
        SimpleNamespace(alive=lambda: list(alive), incarnation=lambda node: bytes(16) if node == ONE else None),
    )
    return NodePorts(
        cast(Any, clock), ME, cast(Any, post), cast(Any, routing), cast(Any, roster), cast(Any, links), lambda known: known == GONE
    ), links


def test_what_is_said_about_a_log_comes_to_it_from_nodes_alone() -> None:
    clock, logs, log = Clock(), Logs(), Heard()
    logs.add(cast(Any, log))
    intake = Intake(cast(Any, clock), logs)
    for message in (AskLog(GENESIS, 3), learn(4)):
        intake.take(packet_of(message), f"node:{ONE}")
        intake.take(packet_of(message), "user:ada")
    intake.take(packet_of(AskLog(bytes(32), 3)), f"node:{ONE}")
    intake.take(RespondSceneLog(None), f"node:{ONE}")
    intake.take(RequestSceneLog(cast(Any, 1), b"", 0, 0, Want.DECIDED), f"node:{ONE}")
    assert log.received == [(ONE, AskLog(GENESIS, 3)), (ONE, learn(4))]


@pytest.mark.expect_log("it says more about logs in which it takes no part")
def test_who_takes_no_part_says_only_so_much() -> None:
    clock, logs, log = Clock(), Logs(), Heard()
    logs.add(cast(Any, log))
    intake = Intake(cast(Any, clock), logs)
    page = next(iter(pages_of([learn(position) for position in range(1, STRANGERS_BURST + 10)])))
    intake.take(page, f"node:{STRANGER}")
    assert len(log.received) == STRANGERS_BURST
    intake.take(page, f"node:{TWO}")
    assert len(log.received) == 2 * STRANGERS_BURST + 9, "who takes part may say what he likes"
    clock.time += 100.0
    log.received.clear()
    for _ in range(STRANGERS_BURST):
        intake.take(packet_of(AskLog(GENESIS, 0)), f"node:{STRANGER}")
    assert len(log.received) == STRANGERS_BURST // ASKING_COUNTS
    # What is decided already is answered with as much.
    for position, taken in ((7, STRANGERS_BURST // ASKING_COUNTS), (8, STRANGERS_BURST)):
        clock.time += 100.0
        log.received.clear()
        for _ in range(STRANGERS_BURST):
            proposal = Propose(GENESIS, ProposalId(position, Ballot(1, ONE), Phase.ACCEPT), (ONE, TWO), (), value=Value(b"data"))
            intake.take(packet_of(proposal), f"node:{STRANGER}")
        assert len(log.received) == taken


async def test_messages_leave_as_packets_and_who_cannot_get_them_is_not_reached() -> None:
    post = Post()
    ports, _ = ports_of(Clock(), post, [])
    await ports.carrier.send(ONE, AskLog(GENESIS, 3))
    await ports.carrier.send(ONE, learn(4), learn(5))
    assert [packet for _, packet in post.told] == [packet_of(AskLog(GENESIS, 3)), *pages_of([learn(4), learn(5)])]
    for problem in (NotReached("gone"), Unreachable("gone"), Refused(RejectReason.ILL_FORMED, "an older program")):
        post.problem = problem
        with pytest.raises(Unreachable):
            await ports.carrier.send(ONE, AskLog(GENESIS, 3))


@pytest.mark.expect_log("something of a log is not sent")
async def test_what_cannot_be_said_ends_no_log() -> None:
    post = Post()
    post.problem = LocalFault("out of bounds")
    ports, _ = ports_of(Clock(), post, [])
    await ports.carrier.send(ONE, cast(Learn, learn(4)))


def test_the_world_is_as_line_and_roster_say_and_lost_connections_are_told() -> None:
    clock, alive = Clock(), [ONE, ME]
    ports, links = ports_of(clock, Post(), alive)
    assert ports.around.line() == (ONE, ME, TWO)
    assert ports.around.alive() == ports.around.reachable() == {ONE}
    alive.append(TWO)
    clock.time += LOOK_S
    assert ports.around.alive() == {ONE, TWO}
    assert ports.around.is_current(member(ONE))
    assert ports.around.is_gone(replace(member(ONE), incarnation=GONE)) and not ports.around.is_gone(member(ONE))
    assert not ports.around.is_current(member(ONE, 1)) and not ports.around.is_current(member(TWO))
    log = Heard()
    ports.logs.add(cast(Any, log))
    links.on_lost(address_of(ONE), Priority.LOW)
    assert log.lost_nodes == []
    links.on_lost(address_of(ONE), Priority.HIGH)
    assert log.lost_nodes == [ONE]
