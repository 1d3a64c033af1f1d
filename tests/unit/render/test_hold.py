"""If this fails, one organiser that says nothing holds the places of a node, or a job ends because its nodes prepare for long."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.render.pool import service
from scenefold.render.pool.hold import LOOK_S, PREPARE_S_MAX, QUIET_LOOKS, SILENT_LOOKS_MAX, WAITING_LOOKS_MAX, WORD_S, Hold
from scenefold.render.pool.keeping import keep_places
from scenefold.render.pool.part import Part
from scenefold.render.pool.service import JOBS_MAX, JOBS_OF_A_NODE_MAX, RenderService
from scenefold.wire import CancelJob, JobAnswer, JobEvent, JobState, JobStateReply, Packet, StartJob, pack_value

ME, ORGANISER, OTHER = NodeId(0x7F000002), NodeId(0x7F000003), NodeId(0x7F000004)
SILENT_S = (SILENT_LOOKS_MAX + 1) * LOOK_S


def test_a_word_holds_a_place_and_silence_gives_it_back() -> None:
    hold = Hold()
    for _ in range(3):
        assert [hold.over() for _ in range(SILENT_LOOKS_MAX)] == [""] * SILENT_LOOKS_MAX
        hold.heard()
    assert [hold.over() for _ in range(SILENT_LOOKS_MAX + 1)][-1] == "is silent"


def test_who_is_silent_for_a_while_gives_way_and_one_word_is_enough_to_stay() -> None:
    hold = Hold()
    for _ in range(2):
        quiet = []
        for _ in range(QUIET_LOOKS):
            quiet.append(hold.is_quiet)
            assert not hold.over()
        assert not any(quiet) and hold.is_quiet
        hold.heard()
    assert not hold.is_quiet and 2 * WORD_S < QUIET_LOOKS * LOOK_S, "one word may be lost"


def test_words_alone_hold_no_place_for_ever_and_a_job_that_runs_goes_on() -> None:
    waiting, running = Hold(), Hold()
    running.go()
    for _ in range(WAITING_LOOKS_MAX):
        assert not waiting.over() and not running.over()
        waiting.heard()
        running.heard()
    assert waiting.over() == "never said that it begins" and not running.over()
    assert WAITING_LOOKS_MAX * LOOK_S > PREPARE_S_MAX


class Waits:
    """A part that is ready at once."""

    has_failed = False
    was_ready = True

    def __init__(self, _host: object, _renderer: object, job: Any, _organiser: object, _log: object, _account: object) -> None:
        self.job, self.hold, self.gone, self._ended = job, Hold(), False, trio.Event()

    @property
    def is_idle(self) -> bool:
        return self.hold.is_quiet

    def forget(self) -> None:
        self._ended.set()

    async def run(self) -> None:
        await self._ended.wait()

    async def prepared(self) -> None:
        await trio.lowlevel.checkpoint()

    async def go(self, _first: int = 0, _occupied: object = None) -> None:
        await trio.lowlevel.checkpoint()
        self.gone = True
        self.hold.go()

    def state(self) -> dict[str, Any]:
        return {"phase": "ready"}

    async def end(self) -> None:
        await trio.lowlevel.checkpoint()
        self._ended.set()


JOBS = range(1, 1 + JOBS_MAX)
"""0 is none: who asks for that asks what memory the node has."""


class Node:
    """A host whose packets come from the test."""

    node_id, memory_bytes = ME, 1 << 30

    def __init__(self) -> None:
        clock = SimpleNamespace(sleep=trio.sleep, now=trio.current_time)
        self.world = SimpleNamespace(clock=clock)
        self.handlers: dict[type[Packet], Any] = {}

    def handle(self, packet: type[Packet], handler: Any, *, nodes_only: bool) -> None:
        self.handlers[packet] = handler

    async def told(self, packet: Packet, by: NodeId = ORGANISER) -> Any:
        return await self.handlers[type(packet)](packet, f"node:{by}")

    async def offered(self, job: int, by: NodeId = ORGANISER) -> int:
        answer = await self.told(StartJob(job=job, document=b"%d" % job), by)
        assert isinstance(answer, JobAnswer)
        return answer.reason


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Node:
    def job_of(document: bytes) -> Any:
        return SimpleNamespace(id=int(document), nodes=(ME, ORGANISER, OTHER))

    monkeypatch.setattr(service, "Part", Waits)
    monkeypatch.setattr(service, "Job", SimpleNamespace(from_bytes=job_of))
    monkeypatch.setattr(RenderService, "_load", lambda _: None)
    return Node()


@pytest.mark.expect_log("its organiser is silent; this node's part ends")
async def test_an_organiser_that_never_says_go_gets_its_places_back_within_two_minutes(node: Node, autojump_clock: MockClock) -> None:
    host: Any = node
    async with trio.open_nursery() as nursery:
        await nursery.start(RenderService(host).run)
        assert [await node.offered(job) for job in JOBS[:JOBS_OF_A_NODE_MAX]] == [0] * JOBS_OF_A_NODE_MAX
        assert await node.offered(90) != 0
        await trio.sleep(SILENT_S + LOOK_S)
        with pytest.raises(Refused, match="takes no part"):
            await node.told(JobState(job=JOBS[0]))
        assert await node.offered(91) == 0
        nursery.cancel_scope.cancel()


async def test_an_organiser_that_died_takes_no_places_from_those_that_live(node: Node, autojump_clock: MockClock) -> None:
    host: Any = node
    async with trio.open_nursery() as nursery:
        await nursery.start(RenderService(host).run)
        for job in JOBS[:JOBS_OF_A_NODE_MAX]:
            assert await node.offered(job) == 0
        for job in JOBS[JOBS_OF_A_NODE_MAX:]:
            assert await node.offered(job, OTHER) == 0
        assert await node.offered(90, OTHER) != 0
        for _ in range(QUIET_LOOKS + 1):
            await trio.sleep(LOOK_S)
            for job in JOBS[JOBS_OF_A_NODE_MAX:]:
                assert isinstance(await node.told(JobState(job=job), OTHER), JobStateReply)
        assert await node.offered(91, OTHER) == 0
        with pytest.raises(Refused, match="takes no part"):
            await node.told(JobState(job=JOBS[0]))
        for job in JOBS[1:JOBS_OF_A_NODE_MAX]:
            assert isinstance(await node.told(JobState(job=job)), JobStateReply), "one place was needed, and no more"
        nursery.cancel_scope.cancel()


@pytest.mark.expect_log("its organiser is silent; this node's part ends")
async def test_the_organisers_word_holds_a_place_and_nobody_elses(node: Node, autojump_clock: MockClock) -> None:
    host: Any = node
    almost_s = SILENT_LOOKS_MAX * LOOK_S - 1
    async with trio.open_nursery() as nursery:
        await nursery.start(RenderService(host).run)
        await node.offered(1)
        await trio.sleep(almost_s)
        assert isinstance(await node.told(JobState(job=1)), JobStateReply)
        await trio.sleep(almost_s)
        assert isinstance(await node.told(JobState(job=1), OTHER), JobStateReply), "it is held, and a node of the job may ask"
        await trio.sleep(LOOK_S)
        with pytest.raises(Refused, match="takes no part"):
            await node.told(JobState(job=1))
        nursery.cancel_scope.cancel()


async def test_only_who_offered_a_job_begins_and_ends_it(node: Node, autojump_clock: MockClock) -> None:
    host: Any = node
    async with trio.open_nursery() as nursery:
        await nursery.start(RenderService(host).run)
        await node.offered(1)
        go = JobEvent(job=1, document=pack_value({"go": True}))
        for packet in (go, CancelJob(job=1)):
            with pytest.raises(Refused, match="does not organise the job"):
                await node.told(packet, OTHER)
            assert not (await node.told(packet)).reason
        nursery.cancel_scope.cancel()


async def test_while_one_node_prepares_for_long_the_others_hear_of_the_job(autojump_clock: MockClock) -> None:
    """And one that does not answer keeps nobody else's word back."""
    host, heard = Node(), []

    async def ask(to: NodeId, packet: Packet, timeout_s: float) -> Packet:
        if to == OTHER:
            await trio.sleep(timeout_s)
            raise Unreachable("it is silent")
        await trio.lowlevel.checkpoint()
        heard.append(trio.current_time())
        return JobStateReply(job=1, document=b"")

    host.ask = ask  # type: ignore[attr-defined]
    job: Any = SimpleNamespace(id=1, nodes=(ORGANISER, OTHER))
    with trio.move_on_after(PREPARE_S_MAX):
        await keep_places(host, job, lambda: job.nodes)  # type: ignore[arg-type]
    gaps = [after - before for before, after in zip([0.0, *heard], heard, strict=False)]
    assert heard[-1] > PREPARE_S_MAX - LOOK_S and max(gaps) < LOOK_S


async def test_who_is_lost_hears_nothing_more(autojump_clock: MockClock) -> None:
    host, heard = Node(), []
    living = [ORGANISER, OTHER]

    async def ask(to: NodeId, packet: Packet, timeout_s: float) -> Packet:
        await trio.lowlevel.checkpoint()
        heard.append(to)
        return JobStateReply(job=1, document=b"")

    host.ask = ask  # type: ignore[attr-defined]
    job: Any = SimpleNamespace(id=1, nodes=(ORGANISER, OTHER))
    with trio.move_on_after(1.5 * WORD_S):
        await keep_places(host, job, lambda: living)  # type: ignore[arg-type]
    assert sorted(heard) == sorted(living)
    living.remove(OTHER)
    with trio.move_on_after(1.5 * WORD_S):
        await keep_places(host, job, lambda: living)  # type: ignore[arg-type]
    assert sorted(heard) == sorted([ORGANISER, ORGANISER, OTHER])


async def test_who_waits_for_a_part_that_ends_meanwhile_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else its organiser takes it for ready, and hears of something else later."""
    part = Part.__new__(Part)
    part.failure, part._was_ready, part._prepared = None, False, trio.Event()
    told: list[Refused] = []

    async def wait() -> None:
        with pytest.raises(Refused, match="ended while it was prepared") as caught:
            await part.prepared()
        told.append(caught.value)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(wait)
        await trio.testing.wait_all_tasks_blocked()
        part._prepared.set()
    assert [refusal.reason for refusal in told] == [RejectReason.NOT_READY]
