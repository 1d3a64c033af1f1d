"""If one fails, each node imports at its start what only renders need, or one that is asked to render for the first time does not answer."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.node import rendering
from scenefold.node.rendering import ASKED_BY_ANYBODY, ASKED_BY_NODES, RenderExtension, RenderHost
from scenefold.peer import Senders
from scenefold.render.pool.service import RenderService
from scenefold.wire import AcknowledgeRays, CancelJob, CollectPass, JobAnswer, JobState, Packet
from scenefold.world import Priority

Handler = Callable[[Packet, str], Awaitable[Packet | None]]


class Handlers:
    def __init__(self) -> None:
        self.all: dict[type[Packet], tuple[Handler, Senders]] = {}

    def add(self, packet: type[Packet], handler: Handler, *, senders: Senders) -> None:
        self.all[packet] = handler, senders


class Workers:
    """Which take a while."""

    def __init__(self) -> None:
        self.calls = 0

    async def run(self, _lane: str, function: Callable[[], Any]) -> Any:
        self.calls += 1
        await trio.sleep(1.0)
        return function()


class Service:
    """Like RenderService, with one answer."""

    def __init__(self, host: RenderHost) -> None:
        self._host = host

    async def run(self, *, task_status: trio.TaskStatus[None]) -> None:
        self._host.handle(CancelJob, self._on_cancel, nodes_only=False)
        await trio.sleep(1.0)
        task_status.started()
        await trio.sleep_forever()

    async def _on_cancel(self, packet: CancelJob, peer: str) -> JobAnswer:
        return JobAnswer(job=packet.job, reason=0, text=peer)


def a_context() -> Any:
    world = SimpleNamespace(workers=Workers(), clock=SimpleNamespace(sleep=trio.sleep))
    return SimpleNamespace(handlers=Handlers(), world=world, settings=SimpleNamespace(memory_budget_bytes=1 << 30))


def test_what_a_node_consists_of_is_imported_without_kernels() -> None:
    code = "import sys, scenefold.node.program, scenefold.node.rendering; sys.exit('numba' in sys.modules or 'embreex' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


async def test_the_first_question_begins_the_service_once(monkeypatch: pytest.MonkeyPatch, autojump_clock: trio.testing.MockClock) -> None:
    monkeypatch.setattr(rendering, "_imported", lambda: Service)
    context = a_context()
    answers: list[Packet | None] = []

    async def asks(peer: str, patience_s: float = 60.0) -> None:
        with trio.move_on_after(patience_s):
            answers.append(await context.handlers.all[CancelJob][0](CancelJob(job=3), peer))

    async with trio.open_nursery() as nursery:
        await nursery.start(lambda **status: RenderExtension().run(context, **status))
        assert context.world.workers.calls == 0
        async with trio.open_nursery() as askers:
            # It goes away in the midst of the start.
            askers.start_soon(asks, "user:hasty", 1.5)
            askers.start_soon(asks, "user:one")
            askers.start_soon(asks, "user:two")
        await asks("user:three")
        assert {answer.text for answer in answers if isinstance(answer, JobAnswer)} >= {"user:one", "user:two", "user:three"}
        assert context.world.workers.calls == 1
        nursery.cancel_scope.cancel()


async def test_all_that_the_service_answers_is_answered_before_there_is_one(autojump_clock: trio.testing.MockClock) -> None:
    context = a_context()
    host: Any = RenderHost(context)
    async with trio.open_nursery() as nursery:
        await nursery.start(RenderService(host).run)
        await nursery.start(lambda **status: RenderExtension().run(context, **status))
        assert set(host.handlers) == set(context.handlers.all) == {*ASKED_BY_ANYBODY, *ASKED_BY_NODES}
        asked_by_anybody = {packet for packet, (_, senders) in context.handlers.all.items() if senders is Senders.ANY}
        assert asked_by_anybody == set(ASKED_BY_ANYBODY)
        with pytest.raises(AssertionError, match="by nobody"):
            host.handle(JobState, None, nodes_only=True)
        nursery.cancel_scope.cancel()


async def test_what_is_small_does_not_wait_behind_rays_and_sums() -> None:
    """On a slow line: a node whose answer comes too late is taken for lost."""
    went: list[tuple[type[Packet], Priority]] = []

    class Peers:
        async def ask(self, _node: NodeId, priority: Priority, packet: Packet, _answer: type[Packet], _timeout: float) -> Packet:
            went.append((type(packet), priority))
            return packet

        async def tell(self, _node: NodeId, priority: Priority, packet: Packet, _timeout: float) -> None:
            went.append((type(packet), priority))

    host = RenderHost(cast(Any, SimpleNamespace(peers=Peers())))
    for asked in (JobState(job=1), CollectPass(job=1, pass_index=0, attempt=0)):
        await host.ask(NodeId(1), asked, 1.0)
    await host.send(NodeId(1), AcknowledgeRays(job=1, attempt=0, all_until=0, selective=b""))
    assert went == [(JobState, Priority.HIGH), (CollectPass, Priority.LOW), (AcknowledgeRays, Priority.HIGH)]
