"""If this fails, machines that have slept together take each other for dead on waking, as nobody has spoken for as long as they slept."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.ids import NodeId
from scenefold.peer.membership.evicting import Evicting
from scenefold.peer.membership.waking import SLEPT_S_MIN, Waking
from scenefold.peer.timing import T_EVICT_S
from scenefold.wire import Member

ME, OTHERS = NodeId(1), (NodeId(2), NodeId(3))


class Clock:
    """Goes on while the machine sleeps; runs a little too fast."""

    def __init__(self) -> None:
        self.slept_s = 0.0

    def now(self) -> float:
        return 1.009 * trio.current_time() + self.slept_s

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds / 1.009)


async def test_a_clock_that_is_wrong_is_no_sleep_and_a_jump_is_one(autojump_clock: MockClock) -> None:
    clock = Clock()
    waking = Waking(cast(Any, clock))
    for _ in range(200):
        assert waking.since() == -math.inf
        await trio.sleep(10.0)
    clock.slept_s += SLEPT_S_MIN + 1.0
    woken_at = clock.now()
    assert waking.since() == woken_at
    await trio.sleep(100.0)
    assert waking.since() == woken_at
    clock.slept_s += 3_600.0
    assert waking.since() == clock.now()


def evicting(clock: Clock, heard: dict[NodeId, float]) -> Evicting:
    """At a voter of three."""
    members = [Member(node, bytes(16)) for node in (ME, *OTHERS)]
    voters = SimpleNamespace(everyone=members, nodes={ME, *OTHERS}, majority=2)
    voting = SimpleNamespace(deciders=voters, councils=[SimpleNamespace(position=0)])
    log = SimpleNamespace(
        registry=SimpleNamespace(voting=voting),
        voting=SimpleNamespace(is_ready=True),
        learnt_at=lambda _position: 0.0,
        leased_at=lambda _node: None,
    )
    return Evicting(cast(Any, clock), cast(Any, log), cast(Any, SimpleNamespace(proof_at=heard.get)), ME)


@pytest.mark.parametrize("hours", [0.0, 10.0])
async def test_a_voter_that_speaks_later_than_another_one_is_not_gone(autojump_clock: MockClock, hours: float) -> None:
    clock, heard = Clock(), dict.fromkeys(OTHERS, 0.0)
    watch = evicting(clock, heard)
    assert watch.away() == []
    clock.slept_s += 3_600.0 * hours
    await trio.sleep(1.0)
    heard[OTHERS[0]] = clock.now()
    assert watch.away() == []
    for _ in range(int(T_EVICT_S) + 30):
        await trio.sleep(1.0)
        heard[OTHERS[0]] = clock.now()
        watch._waking.since()
    assert watch.away() == [OTHERS[1]], "it is if it stays silent"
