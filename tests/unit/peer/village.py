"""Nodes that gossip and probe, through a network in memory, in virtual time: no sockets, no waiting, no store.

Each has its own view of a cluster's log that the test writes; what one proposes is committed for all, unless the test
says otherwise.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.location import arcs_between, even_right_bounds
from scenefold.base.reasons import RejectReason
from scenefold.crypto import MemberSecrets, SealingKey, SigningKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Senders
from scenefold.peer.membership.gossip import Gossip
from scenefold.peer.membership.probing import Probing
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import AddNode, Found, Founder, LogEntry, LogRecord, Member, Packet, RemoveNode
from scenefold.world import Endpoint, Ports, World
from scenefold.world.facts import ClusterFacts, Credential
from unit.inline_workers import InlineWorkers

FIRST = node_id_of("127.0.0.2")
DELAY_S = 0.001
BETWEEN_ROUNDS_S = 0.5
"""Nodes that start together throw their dice in the same moments, in any order: what is compared then is chance."""


def node_at(index: int) -> NodeId:
    return NodeId(FIRST + index)


def incarnation_of(index: int) -> bytes:
    return index.to_bytes(16, "big", signed=True) if index else b"\xff" * 16


def key_of(node: NodeId) -> SigningKey:
    return SigningKey.from_seed(node.to_bytes(4, "big") * 8)


def sealing_key_of(node: NodeId) -> SealingKey:
    return SealingKey(node.to_bytes(4, "little") * 8)


@dataclass
class Ether:
    """Carries datagrams between addresses, and counts them. `lost(source, target)` says which never arrive."""

    boxes: dict[str, trio.MemorySendChannel[tuple[bytes, Endpoint]]] = field(default_factory=dict)
    sent: list[tuple[str, str, bytes]] = field(default_factory=list)
    lost: Callable[[str, str], bool] = lambda _source, _target: False

    def send(self, data: bytes, source: str, target: str) -> None:
        self.sent.append((source, target, data))
        box = self.boxes.get(target)
        if box is not None and not self.lost(source, target):
            box.send_nowait((data, Endpoint(source, 1)))

    def lose_first(self, count: int, source: str, target: str) -> None:
        """Of what goes from one address to another, the first few never arrive."""
        left = count

        def lost(*path: str) -> bool:
            nonlocal left
            if path != (source, target):
                return False
            left -= 1
            return left >= 0

        self.lost = lost


class Box:
    """`Datagrams` of one address."""

    def __init__(self, ether: Ether, address: str) -> None:
        self._ether, self.here = ether, Endpoint(address, 1)
        ether.boxes[address], self._inbox = trio.open_memory_channel[tuple[bytes, Endpoint]](10_000)

    async def send(self, data: bytes, target: Endpoint | str) -> None:
        self._ether.send(data, self.here.address, target if isinstance(target, str) else target.address)

    async def receive(self) -> tuple[bytes, Endpoint]:
        return await self._inbox.receive()

    async def aclose(self) -> None:
        self._ether.boxes.pop(self.here.address, None)


class TrioClock:
    stopwatch = None

    def now(self) -> float:
        return trio.current_time()

    def wall(self) -> float:
        return trio.current_time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


def a_world(ether: Ether, random: Random) -> World:
    async def open_datagrams(address: str, _priority: object) -> Box:
        return Box(ether, address)

    network = SimpleNamespace(open_datagrams=open_datagrams)
    entropy = SimpleNamespace(uniform=random.random, token=random.randbytes)
    return World(TrioClock(), cast(Any, entropy), cast(Any, InlineWorkers()), cast(Any, network), cast(Any, None))


class Log:
    """A node's view of the cluster's log, in the manner of ClusterLog."""

    def __init__(self, village: Village, me: NodeId) -> None:
        self._village, self._me = village, me
        self.registry = Registry()
        self.claims: list[tuple[NodeId, int]] = []
        self.lapsed_nodes: list[NodeId] = []
        self._news = trio.Event()

    def adopt(self, registry: Registry) -> None:
        self.registry = registry
        self._village.nodes[self._me].own.log_position = registry.position
        self._news.set()
        self._news = trio.Event()

    async def changed_after(self, position: int) -> Registry:
        while self.registry.position <= position:
            await self._news.wait()
        return self.registry

    def heard_of(self, node: NodeId, position: int) -> None:
        self.claims.append((node, position))

    def lapsed(self) -> list[NodeId]:
        return list(self.lapsed_nodes)

    def leased_at(self, _node: NodeId) -> float | None:
        return None

    async def propose(self, entry: LogEntry) -> int:
        return await self._village.decide(entry, self._me)


class Calls:
    """Requests over connections: `Peers` of one node. A call is lost when a datagram either way would be."""

    def __init__(self, village: Village, me: NodeId) -> None:
        self._village, self._me = village, me

    async def ask(self, member: NodeId, _priority: object, packet: Packet, answer: type[Packet], timeout: float) -> Packet:
        source, target = address_of(self._me), address_of(member)
        node, lost = self._village.nodes.get(member), self._village.ether.lost
        self._village.calls.append((self._me, member, packet))
        if node is None or target not in self._village.ether.boxes or lost(source, target) or lost(target, source):
            await trio.sleep(timeout)
            self._village.nodes[self._me].roster.note_refusal(member)
            raise Unreachable("no answer", where=target)
        await trio.sleep(DELAY_S)
        try:
            reply = await node.handlers[type(packet)](packet, f"node:{self._me}")
        except ScenefoldError as error:
            raise error
        self._village.nodes[self._me].roster.hear_mini(node.own.mini(), trio.current_time())
        assert isinstance(reply, answer)
        return reply


@dataclass
class Node:
    """One node, with its own handlers by packet class."""

    own: OwnStatus
    roster: Roster
    gossip: Gossip
    probing: Probing
    log: Log
    handlers: dict[type[Packet], Any]

    def add(self, packet: type[Packet], handler: Any, *, senders: Senders = Senders.ANY) -> None:
        assert packet not in self.handlers
        self.handlers[packet] = handler


@dataclass
class Village:
    """Nodes on one network. The first one is the voter."""

    nursery: trio.Nursery
    ether: Ether = field(default_factory=Ether)
    nodes: dict[NodeId, Node] = field(default_factory=dict)
    registry: Registry = field(default_factory=Registry)
    calls: list[tuple[NodeId, NodeId, Packet]] = field(default_factory=list)
    proposals: list[tuple[NodeId, LogEntry]] = field(default_factory=list)
    scopes: dict[NodeId, trio.CancelScope] = field(default_factory=dict)
    reaches_voter: Callable[[NodeId], bool] = lambda _node: True

    def of(self, index: int) -> Node:
        return self.nodes[node_at(index)]

    async def start(self, index: int, *, probing: bool = False) -> None:
        await self.nursery.start(self._live, index, probing)

    def crash(self, index: int) -> None:
        self.scopes.pop(node_at(index)).cancel()

    async def _live(self, index: int, probing: bool, *, task_status: trio.TaskStatus[None]) -> None:
        node = self.of(index)
        with trio.CancelScope() as self.scopes[node_at(index)]:
            async with trio.open_nursery() as nursery:
                await nursery.start(node.gossip.run)
                if probing:
                    await nursery.start(node.probing.run)
                task_status.started()

    def commit(self, entry: LogEntry, origin: NodeId = FIRST) -> int:
        """Put an entry into everybody's log."""
        position = self.registry.position + 1
        record = LogRecord(position, self.registry.head, position.to_bytes(16, "big"), origin, entry)
        self.registry = self.registry.apply(record)
        for node in self.nodes.values():
            node.log.adopt(self.registry)
        return position

    async def decide(self, entry: LogEntry, proposer: NodeId) -> int:
        """As the voter does: a removal of somebody else only without its veto."""
        self.proposals.append((proposer, entry))
        await trio.sleep(DELAY_S)
        if not self.reaches_voter(proposer):
            raise Unreachable("the voter does not answer")
        if isinstance(entry, RemoveNode):
            objection = await self.of(0).probing.veto(entry.member)
            if objection is not None:
                raise Refused(RejectReason.BUSY, objection)
        return self.commit(entry, proposer)

    def register(self, index: int, incarnation: bytes | None = None) -> None:
        """A founder takes its seat."""
        node = node_at(index)
        member = Member(node, incarnation or incarnation_of(index))
        self.commit(AddNode(member, key_of(node).public.raw, sealing_key_of(node).public.raw, address_of(node), NodeId(0)))


@asynccontextmanager
async def village(
    count: int, *, seeds: tuple[str, ...] = (), registered: int | None = None, remove_after_s: float = 120.0
) -> AsyncIterator[Village]:
    """`count` nodes with credentials, all founders; the first `registered` of them (all) have taken their seats."""
    members = [node_at(index) for index in range(count)]
    facts = ClusterFacts(
        name="village",
        cluster_id=bytes(16),
        ports=Ports(),
        seeds=seeds,
        credentials=tuple(
            Credential(member, address_of(member), key_of(member).public, sealing_key_of(member).public) for member in members
        ),
        founders=tuple(members),
        voters=(FIRST,),
        log_key=key_of(FIRST).public,
    )
    arcs = arcs_between(even_right_bounds(count))
    async with trio.open_nursery() as nursery:
        them = Village(nursery)
        for index, member in enumerate(members):
            own = OwnStatus(member, address_of(member), incarnation_of(index), 1, MemberSecrets(key_of(member), sealing_key_of(member)))
            own.arc = arcs[index]
            # Each has dice of its own: in which order tasks of one moment run, is the scheduler's whim.
            world, roster, log = a_world(them.ether, Random(member)), Roster(member), Log(them, member)
            calls = cast(Any, Calls(them, member))
            gossip = Gossip(world, own, roster, cast(Any, log), facts, seeds)
            settings = cast(Any, SimpleNamespace(remove_after_s=remove_after_s))
            probing = Probing(world, gossip, roster, calls, cast(Any, log), own, settings)
            them.nodes[member] = node = Node(own, roster, gossip, probing, log, {})
            probing.register(cast(Any, node))
        founders = tuple(
            Founder(member, key_of(member).public.raw, sealing_key_of(member).public.raw, address_of(member)) for member in members
        )
        them.commit(Found(founders, (FIRST,)))
        for index in range(count if registered is None else registered):
            them.register(index)
        yield them
        nursery.cancel_scope.cancel()


async def until(condition: Callable[[], bool]) -> None:
    """Let virtual seconds pass until the condition holds: what it looks at is pure and tells nobody of changes."""
    for _ in iter(condition, True):
        await trio.sleep(1.0)
