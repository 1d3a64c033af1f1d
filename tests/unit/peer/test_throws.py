"""If this fails, one member that speaks without end makes all others look dead."""

from __future__ import annotations

import pytest
import trio
import trio.testing
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.peer.membership.throws import ROUND_S, THROWS_MAX, Throws
from scenefold.wire import PingBroadcast, encode_packet
from unit.peer.village import Node, Village, node_at, village

EVERY_S = 0.1
MEMBER = NodeId(7)


@given(st.integers(2, 1000), st.lists(st.floats(0.0, 30.0), max_size=200))
def test_in_no_stretch_of_time_more_broadcasts_count_than_the_dice_give(count: int, pauses: list[float]) -> None:
    throws, now, counted = Throws(), 0.0, 0
    for pause_s in pauses:
        now += pause_s
        counted += throws.take(MEMBER, count, now)
        assert counted <= THROWS_MAX + now / (ROUND_S * count) + 1e-6


def test_the_rate_of_the_dice_counts_for_ever() -> None:
    throws = Throws()
    assert all(throws.take(MEMBER, 50, second * 50.0) for second in range(1000))


def test_each_member_has_throws_of_its_own_and_who_leaves_is_forgotten() -> None:
    throws, other = Throws(), NodeId(8)
    assert [throws.take(MEMBER, 5, 0.0) for _ in range(5)] == [True] * THROWS_MAX + [False] * (5 - THROWS_MAX)
    assert throws.take(other, 5, 0.0)
    throws.keep(lambda node: node == other)
    assert throws.take(MEMBER, 5, 0.0), "who comes back begins anew"


async def flood(liar: Node, targets: list[NodeId]) -> None:
    while True:
        data = encode_packet(PingBroadcast((liar.own.signed(),)))
        for target in targets:
            await liar.gossip._datagrams.send(data, target)
        await trio.sleep(EVERY_S)


async def begin(them: Village, count: int) -> None:
    """Nodes that know each other; the second one speaks ten times a second."""
    for index in range(count):
        await them.start(index)
    for index in range(count):
        await them.of(index).gossip.everybody_heard()
    them.nursery.start_soon(flood, them.of(1), [node_at(index) for index in range(count) if index != 1])


async def test_who_speaks_without_end_makes_nobody_look_dead(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await begin(them, 5)
        believed = 0
        for _ in range(100):
            await trio.sleep(1.0)
            believed += len(them.of(0).roster.alive())
        assert believed >= 4.5 * 100, "five live; chance alone makes one look dead one time in twenty"


async def test_who_is_no_member_throws_no_dice(autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    async with village(3) as them:
        for index in range(3):
            await them.start(index)
        for index in range(3):
            await them.of(index).gossip.everybody_heard()
        counted = list[object]()
        monkeypatch.setattr(them.of(0).roster, "count_broadcast", counted.append)
        monkeypatch.setattr(them.of(0).roster, "is_peer", lambda node: node != node_at(1))
        news = PingBroadcast((them.of(2).own.signed(),))
        await them.of(1).gossip._datagrams.send(encode_packet(news), node_at(0))
        await trio.testing.wait_all_tasks_blocked()
        assert not counted and them.of(0).roster.status(node_at(2)) == news.statuses[0], "its news count all the same"
