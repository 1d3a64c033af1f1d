"""If this fails, one member that claims what is not in the cluster's log keeps all others asking for it, and honest news wait."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio
import trio.testing

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.peer.cluster_log.log_pull import SOURCES_MAX, LogPuller
from scenefold.peer.timing import LOG_ASK_S_MAX, SYNC_S
from scenefold.wire import Packet, RespondSceneLog
from unit.peer.village import TrioClock

ME, VOTER, LIAR, HONEST = NodeId(50), NodeId(1), NodeId(33), NodeId(34)
FAR = 1 << 63
LONG_S = 6 * SYNC_S


class Others:
    """Those who are asked: they know what we know, and some of them say nothing."""

    def __init__(self) -> None:
        self.asked = Counter[NodeId]()
        self.silent = set[NodeId]()

    async def ask(self, node: NodeId, _priority: object, _packet: Packet, _answer: object, timeout_s: float) -> Packet:
        self.asked[node] += 1
        if node in self.silent:
            await trio.sleep(timeout_s)
            raise Unreachable("it hangs")
        await trio.sleep(0.002)
        return RespondSceneLog(answer=None)


def a_puller(others: Others) -> LogPuller:
    copy = SimpleNamespace(
        position=7, registry=SimpleNamespace(members=[NodeId(number) for number in range(1, 51)], voting=SimpleNamespace(councils=()))
    )
    genesis = SimpleNamespace(scene=1, genesis=bytes(32))
    facts = SimpleNamespace(voter=VOTER, founders=[NodeId(number) for number in range(1, 6)], genesis_header=genesis)
    world = SimpleNamespace(clock=TrioClock(), entropy=SimpleNamespace(uniform=lambda: 0.3))
    return LogPuller(cast(Any, world), cast(Any, others), cast(Any, facts), cast(Any, copy), ME)


async def running(puller: LogPuller, nursery: trio.Nursery) -> None:
    async def run() -> None:
        await puller.run(is_asked_for_news_only=True)

    nursery.start_soon(run)


@pytest.mark.parametrize("hangs", [False, True])
async def test_who_claims_without_end_what_nobody_can_show_is_asked_for_now_and_then(
    hangs: bool, autojump_clock: trio.testing.MockClock
) -> None:
    others = Others()
    others.silent = {LIAR} if hangs else set()
    puller = a_puller(others)
    with trio.move_on_after(LONG_S):
        async with trio.open_nursery() as nursery:
            await running(puller, nursery)
            while True:
                puller.heard_of(LIAR, FAR)
                await trio.sleep(0.2)
    assert 1 < others.asked[LIAR] <= LONG_S / SYNC_S + 1
    assert others.asked.total() <= SOURCES_MAX * (LONG_S / SYNC_S + 1)


async def test_others_are_heeded_while_one_is_not(autojump_clock: trio.testing.MockClock) -> None:
    others = Others()
    puller = a_puller(others)
    async with trio.open_nursery() as nursery:
        await running(puller, nursery)
        for claimant in (LIAR, LIAR, HONEST):
            puller.heard_of(claimant, FAR)
            await trio.sleep(1.0)
        assert (others.asked[LIAR], others.asked[HONEST]) == (1, 1)
        nursery.cancel_scope.cancel()


async def test_the_voter_is_always_heeded(autojump_clock: trio.testing.MockClock) -> None:
    others = Others()
    puller = a_puller(others)
    async with trio.open_nursery() as nursery:
        await running(puller, nursery)
        for _ in range(3):
            puller.heard_of(VOTER, 8)
            await trio.sleep(1.0)
        assert others.asked[VOTER] == 3
        nursery.cancel_scope.cancel()


async def test_to_ask_one_node_waits_for_no_others(autojump_clock: trio.testing.MockClock) -> None:
    others = Others()
    others.silent = {LIAR, NodeId(2)}
    puller = a_puller(others)
    async with trio.open_nursery() as nursery:
        for _ in range(128):
            nursery.start_soon(puller.pull_from, LIAR)
        nursery.start_soon(puller.pull, FAR)
        await trio.sleep(0.1)
        began = trio.current_time()
        await puller.pull_from(VOTER)
        assert trio.current_time() - began < LOG_ASK_S_MAX
        nursery.cancel_scope.cancel()
