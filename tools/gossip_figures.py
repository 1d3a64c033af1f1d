"""What gossip costs and how soon it notices, in a model without network: the real roster and suspicion, lost datagrams.

    .venv/bin/python tools/gossip_figures.py [seconds]          prints a table for docs/benchmarks.md

Every second each of N nodes throws the dice of thesis B.2.2; what it sends is lost with probability 0.02 on its way to each
other node. Up to 64 nodes every one has its roster, and passes on what that holds; of more, some are looked at, and nothing
is passed on, so figures for a thousand are a little worse than the truth. Sizes are those of real datagrams, with the 28
bytes that IP and UDP add.
"""

from __future__ import annotations

import statistics
import sys
from dataclasses import dataclass, field, replace
from random import Random

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.location import Location, even_right_bounds
from scenefold.peer.datagrams import PACKET_BYTES_MAX
from scenefold.peer.membership.odds import broadcasts_missed_max
from scenefold.peer.membership.proofs import PROBE_PAUSES_S
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.suspicion import Cause, Suspicion
from scenefold.wire import Member, MiniStatus, PingBroadcast, RequestState, Status, encode_packet

LOSS = 0.02
WHOLE_MAX = 64
WATCHED = 20
IP_BYTES = 28
OVERHEAD_BYTES = DATAGRAM_BYTES_MAX - PACKET_BYTES_MAX
INCARNATION = b"i" * 16
FIRST = node_id_of("10.0.0.1")


@dataclass(frozen=True)
class Known:
    incarnation: bytes = INCARNATION


@dataclass(frozen=True)
class Line:
    order: tuple[NodeId, ...]
    position: int = 1

    def current(self, _node: NodeId) -> Known:
        return Known()


@dataclass
class Watched:
    """A node with its roster, and what it did."""

    roster: Roster
    suspicion: Suspicion = field(default_factory=lambda: Suspicion(1e9))
    messages: int = 0
    sent_bytes: int = 0
    suspected: int = 0
    unanswered: int = 0


class Model:
    """N nodes of which some are watched."""

    def __init__(self, count: int, seed: int) -> None:
        self.count, self.dice, self.now = count, Random(seed), 0.0
        self.nodes = [NodeId(FIRST + index) for index in range(count)]
        self.bounds = even_right_bounds(count)
        self.lamports = dict.fromkeys(self.nodes, 1 << 32)
        self.dead: set[NodeId] = set()
        watched = self.nodes if count <= WHOLE_MAX else self.nodes[:WATCHED]
        self.watched = {node: Watched(Roster(node)) for node in watched}
        statuses = [self.status(node) for node in self.nodes]
        for one in self.watched.values():
            one.roster.set_members(Line(tuple(self.nodes)), 0.0)
            for status in statuses:
                one.roster.hear(status, 0.0)
        self.status_bytes = len(encode_packet(PingBroadcast((statuses[-1],)))) - len(encode_packet(PingBroadcast(())))
        self.room = PACKET_BYTES_MAX - self.status_bytes - 16
        mini = MiniStatus(1 << 32, FIRST, self.bounds[0], 0, 0, 0, 0, 0, 9)
        self.question_bytes = len(encode_packet(RequestState(request_id=1, mini_status=mini))) + OVERHEAD_BYTES + IP_BYTES
        full = 1 + self.room // self.status_bytes
        self.answer_bytes = OVERHEAD_BYTES + 16 + min(full, count) * self.status_bytes + IP_BYTES

    def status(self, node: NodeId) -> Status:
        index, self.lamports[node] = node - FIRST, self.lamports[node] + 1
        fence: Location | None = self.bounds[index - 1] if index else None
        blank = Status(self.lamports[node], node, INCARNATION, 1, address_of(node), fence, self.bounds[index])
        return replace(
            blank, offline_blocks=1 << 28, online_blocks=1 << 22, offline_fraction=1 << 30, rays_per_second=1 << 20, log_position=99
        )

    def second(self) -> None:
        self.now += 1.0
        for node in self.nodes:
            if node not in self.dead and self.dice.random() * self.count < 1:
                self.broadcast(node)
        for node, one in self.watched.items():
            if node not in self.dead:
                self.look(one)

    def broadcast(self, author: NodeId) -> None:
        statuses, sender = [self.status(author)], self.watched.get(author)
        if sender is not None:
            sender.roster.count_broadcast(())
            sender.messages += self.count - 1
            if self.count <= WHOLE_MAX:
                statuses += sender.roster.page(self.room, lambda _status: self.status_bytes)
            sender.sent_bytes += (self.count - 1) * self.answer_bytes
        for node, one in self.watched.items():
            if node in self.dead or node == author or self.dice.random() < LOSS:
                continue
            heard = [status.node for status in statuses if one.roster.hear(status, self.now, relayed=status.node != author)]
            if heard:
                one.roster.count_broadcast(heard)

    def look(self, one: Watched) -> None:
        one.suspicion.review(lambda member: one.roster.signs(member.node), self.now)
        for node in one.roster.silent():
            is_new = one.suspicion.suspect(Member(node, INCARNATION), Cause.UNLIKELY, one.roster.signs(node), self.now)
            one.suspected += is_new and node not in self.dead
        for suspect in one.suspicion.turn(self.now):
            if self.is_answered(one, suspect.node):
                one.roster.hear(self.status(suspect.node), self.now)
                one.suspicion.heard(suspect, self.now)
            else:
                one.unanswered += suspect.node not in self.dead
                one.suspicion.nobody_hears(suspect, (), 1e9, self.now)

    def is_answered(self, one: Watched, node: NodeId) -> bool:
        for _ in PROBE_PAUSES_S:
            one.messages += 1
            one.sent_bytes += self.question_bytes
            if node in self.dead or self.dice.random() < LOSS:
                continue
            # The answer is somebody else's, but on average each node answers as often as it asks.
            one.messages += 1
            one.sent_bytes += self.answer_bytes
            if self.dice.random() >= LOSS:
                return True
        return False


def figures(count: int, seconds: int) -> str:
    model = Model(count, seed=count)
    for _ in range(4 * count):
        model.second()
    for one in model.watched.values():
        one.messages = one.sent_bytes = one.suspected = one.unanswered = 0
    for _ in range(seconds):
        model.second()
    nodes = len(model.watched) * seconds
    messages = sum(one.messages for one in model.watched.values()) / nodes
    sent = sum(one.sent_bytes for one in model.watched.values()) / nodes
    suspected = sum(one.suspected for one in model.watched.values()) / nodes * 3600
    unanswered = sum(one.unanswered for one in model.watched.values()) / nodes * 3600
    victim, died_at = model.nodes[-1], model.now
    noticed: dict[NodeId, float] = {}
    model.dead.add(victim)
    while len(noticed) < len(model.watched) - (victim in model.watched):
        model.second()
        for node, one in model.watched.items():
            if node != victim and node not in noticed and victim in one.roster.silent():
                noticed[node] = model.now - died_at
    times = sorted(noticed.values())
    return (
        f"| {count} | {broadcasts_missed_max(count)} | {statistics.median(times):.0f} / {times[-1]:.0f} "
        f"| {suspected:.1f} | {unanswered:.2f} | {messages:.2f} | {sent:.0f} |"
    )


if __name__ == "__main__":
    duration = int(sys.argv[1]) if len(sys.argv) > 1 else 3600
    print("| nodes | broadcasts to p < 1/20 | s until suspected by gossip alone, median / last | false suspicions per node and hour "
          "| of these with no answer to three probes | messages sent per node and s | bytes sent per node and s |")  # fmt: skip
    print("| ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for size in (5, 50, 1000):
        print(figures(size, duration))
