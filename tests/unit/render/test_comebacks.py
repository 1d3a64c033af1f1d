"""If this fails, a node that takes part in a render is told to begin anew, or one that is back is forgotten, or asked all the time."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import cast

import trio
from trio.testing import MockClock

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.render.pool.comebacks import ANSWERED_S, COMEBACKS_MAX, LASTING_S, LOOK_S, LOOK_S_MAX, Comebacks
from scenefold.render.pool.host import Host
from scenefold.wire import CancelJob, JobAnswer, JobEvent, JobState, JobStateReply, Packet, StartJob
from unit.peer.village import TrioClock
from unit.render.test_job import JOB

A, B = NodeId(1), NodeId(2)


class Stage:
    """Nodes that answer after a while, or never."""

    def __init__(self) -> None:
        self.world = SimpleNamespace(clock=TrioClock())
        self.lost: set[NodeId] = {A, B}
        self.slow_s: dict[NodeId, float] = {}
        self.away: set[NodeId] = set()
        self.asked: list[tuple[float, NodeId, type[Packet]]] = []
        self.is_worth = True
        self.comebacks = Comebacks(cast(Host, self), JOB, lambda: self.lost, lambda: self.is_worth, {"go": True})

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet:
        self.asked.append((trio.current_time(), node, type(packet)))
        await trio.sleep(self.slow_s.get(node, 0.0))
        if node in self.away:
            raise Unreachable("gone")
        return JobStateReply(1, b"") if isinstance(packet, JobState) else JobAnswer(1, 0, "")

    def kinds(self, node: NodeId) -> list[type[Packet]]:
        return [kind for _, one, kind in self.asked if one == node]

    async def until_ready(self) -> None:
        for _ in range(1_000):
            if self.comebacks.ready():
                return
            await trio.sleep(0.5)
        raise AssertionError("nobody comes back")

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self.comebacks.run)
            yield
            nursery.cancel_scope.cancel()


async def test_who_is_back_is_made_ready_once_and_asked_until_it_joins(autojump_clock: MockClock) -> None:
    stage = Stage()
    stage.away = {B}
    async with stage.running():
        await trio.sleep(LOOK_S + 0.1)
        assert stage.comebacks.ready() == {A}
        assert stage.kinds(A) == [CancelJob, StartJob, JobEvent]
        await trio.sleep(3 * LOOK_S)
        assert stage.comebacks.ready() == {A} and stage.kinds(A)[3:] == [JobState] * 3
        stage.is_worth = False
        assert stage.comebacks.ready() == set()


async def test_one_that_is_slow_holds_up_no_other_and_who_takes_part_is_told_nothing(autojump_clock: MockClock) -> None:
    stage = Stage()
    stage.slow_s = {A: 3.0}
    async with stage.running():
        await trio.sleep(LOOK_S + 0.1)
        assert stage.comebacks.ready() == {B}
        stage.lost = {A}
        stage.comebacks.joined([B])
        before = len(stage.kinds(B))
        await trio.sleep(120.0)
        assert len(stage.kinds(B)) == before and stage.comebacks.ready() == {A}


async def test_who_does_not_answer_any_more_is_not_ready(autojump_clock: MockClock) -> None:
    stage = Stage()
    async with stage.running():
        await trio.sleep(LOOK_S + 0.1)
        stage.slow_s = {A: 1000.0}
        stage.away = {B}
        await trio.sleep(ANSWERED_S + LOOK_S)
        assert stage.comebacks.ready() == set()


async def test_it_is_looked_for_seldom_and_later_if_it_never_stays(autojump_clock: MockClock) -> None:
    stage = Stage()
    stage.lost, stage.away = {A}, {A}
    async with stage.running():
        await trio.sleep(10 * LOOK_S_MAX)
        assert 8 < len(stage.asked) < 20
        stage.away = set()
        waits = []
        for stays_s in (1.0, 1.0, 1.0, LASTING_S + 5 * LOOK_S):
            await stage.until_ready()
            stage.lost = set()
            stage.comebacks.joined([A])
            await trio.sleep(stays_s)
            stage.lost = {A}
            lost_at = trio.current_time()
            await stage.until_ready()
            waits.append(trio.current_time() - lost_at)
    assert waits[0] < waits[1] < waits[2] and waits[3] < waits[1]


async def test_there_are_so_many_and_no_more(autojump_clock: MockClock) -> None:
    stage = Stage()
    async with stage.running():
        await trio.sleep(LOOK_S + 0.1)
        stage.comebacks.joined([A, B] * (COMEBACKS_MAX // 2))
        await trio.sleep(2 * LOOK_S)
        before = len(stage.asked)
        await trio.sleep(100.0)
        assert len(stage.asked) == before and stage.comebacks.ready() == set()
