"""If this fails, nodes don't find each other, or believe what nobody signed.

Datagrams go through a network in memory, in virtual time: no sockets, no waiting.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.crypto import STATUS_DOMAIN, SigningKey, sign_datagram
from scenefold.peer import OwnStatus, Roster, Routing
from scenefold.peer.gossip import Gossip
from scenefold.wire import PingBroadcast, RequestState, RequestTable, Status, encode_packet
from scenefold.world import Endpoint, World

FIRST = node_id_of("127.0.0.2")
DROPPED = pytest.mark.expect_log("is dropped|has no business here")


@dataclass
class Ether:
    """Carries datagrams between addresses; keeps them all."""

    boxes: dict[str, trio.MemorySendChannel[tuple[bytes, Endpoint]]] = field(default_factory=dict)
    sent: list[bytes] = field(default_factory=list)
    lost: Callable[[str, str], bool] = lambda _source, _target: False

    def send(self, data: bytes, source: str, target: str) -> None:
        self.sent.append(data)
        box = self.boxes.get(target)
        if box is not None and not self.lost(source, target):
            box.send_nowait((data, Endpoint(source, 1)))


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
    def now(self) -> float:
        return trio.current_time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


def a_world(ether: Ether, random: Random) -> World:
    async def open_datagrams(address: str, _priority: object) -> Box:
        return Box(ether, address)

    network = SimpleNamespace(open_datagrams=open_datagrams)
    entropy = SimpleNamespace(uniform=random.random)
    return World(TrioClock(), cast(Any, entropy), cast(Any, None), cast(Any, network), cast(Any, None))


@dataclass
class Node:
    own: OwnStatus
    roster: Roster
    gossip: Gossip
    key: SigningKey


@dataclass
class Village:
    """Nodes that gossip."""

    ether: Ether
    nodes: dict[NodeId, Node]
    nursery: trio.Nursery

    def of(self, index: int) -> Node:
        return self.nodes[NodeId(FIRST + index)]

    async def start(self, index: int) -> None:
        await self.nursery.start(self.of(index).gossip.run)


@asynccontextmanager
async def village(count: int, seeds: tuple[str, ...] = ()) -> AsyncIterator[Village]:
    ether, random = Ether(), Random(1)
    members = [NodeId(FIRST + index) for index in range(count)]
    signing = {member: SigningKey.from_seed(bytes([member & 255] * 32)) for member in members}
    keys = {member: key.public for member, key in signing.items()}
    routing = Routing(members)
    nodes = {}
    for member in members:
        address, bound = address_of(member), routing.arc_of(member).last
        own = OwnStatus(member, address, bytes(16), 1, bound, signing[member])
        roster = Roster(member, members)
        gossip = Gossip(a_world(ether, random), own, roster, routing, keys, seeds)
        nodes[member] = Node(own, roster, gossip, signing[member])
    async with trio.open_nursery() as nursery:
        yield Village(ether, nodes, nursery)
        nursery.cancel_scope.cancel()


async def until(condition: Callable[[], bool]) -> None:
    """Let virtual seconds pass until the condition holds: what it looks at is pure and tells nobody of changes."""
    for _ in iter(condition, True):
        await trio.sleep(1.0)


async def test_nodes_find_each_other_at_once(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        for index in range(5):
            await them.start(index)
        with trio.fail_after(1.0):
            for node in them.nodes.values():
                await node.gossip.everybody_heard()
                await node.gossip.somebody_heard()
        assert all(len(node.roster.alive()) == 5 for node in them.nodes.values())


async def test_a_seed_tells_of_the_others(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5, seeds=("127.0.0.2",)) as them:
        # The newcomer reaches the seed alone: it knows the rest from its table.
        them.ether.lost = lambda source, target: "127.0.0.6" in (source, target) and "127.0.0.2" not in (source, target)
        for index in range(5):
            await them.start(index)
        with trio.fail_after(120.0):
            await them.of(4).gossip.a_seed_heard()
            await them.of(4).gossip.everybody_heard()


async def test_who_falls_silent_is_not_believed_alive_for_long(autojump_clock: trio.testing.MockClock) -> None:
    async with village(4) as them:
        for index in range(4):
            await them.start(index)
        await them.of(0).gossip.everybody_heard()
        silent = address_of(them.of(3).own.me)
        them.ether.lost = lambda source, _target: source == silent
        with trio.fail_after(300.0):
            await until(lambda: not them.of(0).roster.is_believed_alive(them.of(3).own.me))
        assert them.of(0).roster.is_believed_alive(them.of(1).own.me)
        them.ether.lost = lambda _source, _target: False
        with trio.fail_after(60.0):
            await until(lambda: them.of(0).roster.is_believed_alive(them.of(3).own.me))


async def test_datagrams_stay_small_and_the_table_goes_round(autojump_clock: trio.testing.MockClock) -> None:
    async with village(25) as them:
        for index in range(25):
            await them.start(index)
        with trio.fail_after(10.0):
            for node in them.nodes.values():
                await node.gossip.everybody_heard()
        await trio.sleep(20)
        assert max(map(len, them.ether.sent)) <= DATAGRAM_BYTES_MAX
        assert max(map(len, them.ether.sent)) > DATAGRAM_BYTES_MAX * 3 // 4, "there was room for more"


def forgeries(village: Village) -> dict[str, bytes]:
    """Datagrams for node 0 that must not change what it believes."""
    target, friend, stranger = village.of(0), village.of(1), SigningKey.from_seed(b"?" * 32)
    real = friend.own.signed()
    news = replace(real, lamport=2**60)
    moved = replace(news, address="10.0.0.1")
    greedy = replace(news, right_bound=target.own.signed().right_bound)

    def ping(status: Status, key: SigningKey, sender: NodeId = friend.own.me) -> bytes:
        return sign_datagram(key, sender, 1, encode_packet(PingBroadcast((status,))))

    def by(key: SigningKey, status: Status) -> Status:
        return replace(status, signature=key.sign(STATUS_DOMAIN, status.signable()))

    whole = ping(by(friend.key, real), friend.key)
    return {
        "signed by a stranger": ping(by(stranger, news), stranger),
        "from a stranger": ping(by(friend.key, news), stranger, node_id_of("9.9.9.9")),
        "passed on, but changed": ping(news, friend.key),
        "of another address": ping(by(friend.key, moved), friend.key),
        "of another arc": ping(by(friend.key, greedy), friend.key),
        "truncated": whole[:-10],
        "noise": b"\x00" * 200,
        "empty": b"",
        "no packet": sign_datagram(friend.key, friend.own.me, 1, b"\xc1"),
        "another packet": sign_datagram(friend.key, friend.own.me, 1, encode_packet(RequestTable())),
        "for another": sign_datagram(friend.key, friend.own.me, 1, encode_packet(RequestState()), target=NodeId(5)),
    }


@pytest.mark.parametrize("kind", ["signed by a stranger", "from a stranger", "passed on, but changed", "of another address",
                                  "of another arc", "truncated", "noise", "empty", "no packet", "another packet", "for another"])  # fmt: skip
@DROPPED
async def test_what_does_not_verify_changes_nothing(kind: str, autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        them.ether.send(forgeries(them)[kind], f"10.1.1.{len(kind)}", "127.0.0.2")
        await trio.testing.wait_all_tasks_blocked()
        assert them.of(0).gossip.dropped == 1
        assert them.of(0).roster.unheard() == [them.of(1).own.me]


async def test_a_repeated_status_is_no_sign_of_life(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        friend, roster = them.of(1), them.of(0).roster
        old = sign_datagram(friend.key, friend.own.me, 1, encode_packet(PingBroadcast((friend.own.signed(),))))
        them.ether.send(old, "127.0.0.3", "127.0.0.2")
        await trio.testing.wait_all_tasks_blocked()
        assert roster.is_believed_alive(friend.own.me)
        with trio.fail_after(600):
            while roster.is_believed_alive(friend.own.me):
                them.ether.send(old, "127.0.0.3", "127.0.0.2")
                await trio.sleep(1.0)
        assert them.of(0).gossip.dropped == 0


async def test_a_repeated_question_is_no_flood_of_answers(autojump_clock: trio.testing.MockClock) -> None:
    async with village(2) as them:
        await them.start(0)
        friend = them.of(1)
        question = sign_datagram(friend.key, friend.own.me, 1, encode_packet(RequestState(request_id=1)))
        await trio.testing.wait_all_tasks_blocked()
        before = len(them.ether.sent)
        for _ in range(200):
            them.ether.send(question, "127.0.0.3", "127.0.0.2")
            await trio.testing.wait_all_tasks_blocked()
        answers = sum(data != question and len(data) > 2 * len(question) for data in them.ether.sent[before:])
        assert answers == 1
        await trio.sleep(1.0)
        before = len(them.ether.sent)
        them.ether.send(question, "127.0.0.3", "127.0.0.2")
        await trio.testing.wait_all_tasks_blocked()
        assert any(len(data) > 2 * len(question) for data in them.ether.sent[before:])


async def test_nobody_waits_for_a_node_that_is_alone(autojump_clock: trio.testing.MockClock) -> None:
    async with village(1, seeds=("127.0.0.2",)) as them:
        await them.start(0)
        with trio.fail_after(1.0):
            await them.of(0).gossip.somebody_heard()
            await them.of(0).gossip.a_seed_heard()
            await them.of(0).gossip.everybody_heard()
