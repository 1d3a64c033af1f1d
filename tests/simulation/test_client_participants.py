"""If this fails, a user whose scene is decided by several nodes loses a change, makes it twice, or is told of it what is not so."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import ExitStack

import pytest
import trio

from scenectl.errors import ending_of
from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.client.space import Space
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, Habits, key_of
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.speed import remembered_signatures
from scenefold.wire import ParticipantEntry
from scenefold.world.sim import Point, SimNet, run_simulated

BOX = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
STEP = (1.0, 0.0, 0.0)
START_S_MAX = 60.0


class Court:
    """Nodes, and a client whose scene some of them decide."""

    def __init__(self, cluster: Cluster, client: Client, nursery: trio.Nursery) -> None:
        self.cluster, self.client, self.nursery = cluster, client, nursery
        self.scene: Scene
        self.hall: Space

    async def start(self, *slots: int) -> None:
        for slot in slots:
            await self.cluster.nodes[slot].gone.wait()
            self.cluster.start(slot)
        for slot in slots:
            await self.until(lambda slot=slot: self.cluster.nodes[slot].context is not None)
            with trio.fail_after(START_S_MAX):
                context = self.cluster.nodes[slot].context
                assert context is not None
                await context.joined.wait()

    def crash(self, *slots: int) -> None:
        for slot in slots:
            self.cluster.crash(slot)

    async def until(self, holds: Callable[[], bool], within_s: float = 60.0) -> None:
        with trio.fail_after(within_s):
            while not holds():  # noqa: ASYNC110 - what it waits for is in several nodes, which tell nobody
                await trio.sleep(0.05)

    def entry(self, slot: int) -> ParticipantEntry:
        context = self.cluster.nodes[slot].context
        assert context is not None
        return ParticipantEntry(context.own.member, context.own.key.public.raw)

    def ids(self, *slots: int) -> tuple[NodeId, ...]:
        return tuple(self.entry(slot).member.node for slot in slots)

    def position(self, slot: int) -> int:
        context = self.cluster.nodes[slot].context
        known = None if context is None else context.scenes.here(self.scene.id)
        return 0 if known is None else known.public.position

    async def create(self, *slots: int) -> None:
        self.scene = await self.client.scenes.create("kitchen", participants=[self.entry(slot) for slot in slots])
        self.hall = await self.scene.create_space("hall", BOX)

    async def where(self) -> float:
        """How often the hall was moved."""
        return (await self.hall.info()).transform.offset[0]


def held(count: int, main: Callable[[Court], Awaitable[None]], seed: int = 1) -> None:
    with ExitStack() as stack:
        stack.enter_context(quiet_logs())
        stack.enter_context(remembered_signatures())
        run_simulated(seed, _play, count, main, seed, virtual_s_max=2_000.0, wall_s_max=240.0)


async def _play(count: int, main: Callable[[Court], Awaitable[None]], seed: int) -> None:
    net = SimNet(seed)
    async with trio.open_nursery() as nursery:
        cluster = Cluster(net, count, 1, nursery, Habits(remove_after_s=None))
        world, writer = net.world("user:c"), key_of(seed, "the writer")
        async with open_client("c", world, cluster.facts, MemoryKeyring(), writer, cluster.watch.recorder) as client:
            court = Court(cluster, client, nursery)
            await court.start(*range(count))
            await main(court)
            assert not cluster.watch.violations, cluster.watch.violations
        nursery.cancel_scope.cancel()


def test_one_after_the_other_is_away_and_the_scene_goes_on() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        moved = 0
        for slot in (0, 1, 2):
            court.crash(slot)
            for _ in range(2):
                began = trio.current_time()
                await court.hall.translate(STEP)
                assert trio.current_time() - began < 15.0
                moved += 1
                assert await court.where() == moved
            await court.start(slot)
            await court.until(lambda slot=slot, end=2 + moved: court.position(slot) == end)
        story = await court.scene.log()
        assert [entry.position for entry in story.entries] == list(range(1, 3 + moved))
        assert all(entry.vouched is not None and len(entry.vouched.voters) >= 2 for entry in story.entries[1:])
        assert all(entry.vouched is not None and entry.vouched.seen_s for entry in story.entries[-2:])

    held(4, main)


def test_a_minority_refuses_in_words_and_what_was_refused_never_comes() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2, 3, 4)
        await court.hall.translate(STEP)
        court.crash(2, 3, 4)
        began = trio.current_time()
        with pytest.raises((Refused, Unreachable)) as told:
            await court.hall.translate(STEP)
        assert trio.current_time() - began < 60.0
        if isinstance(told.value, Refused):
            assert told.value.reason is RejectReason.NO_MAJORITY
            assert ending_of(told.value).exit_code == 4 and "3 of 5 must agree" in str(told.value)
        else:
            assert "scene status kitchen" in told.value.remedy
        assert await court.where() == 1.0, "what is there can be read"
        await court.start(2, 3, 4)
        await trio.sleep(60.0)
        assert await court.where() == 1.0 or isinstance(told.value, Unreachable)
        moved = (await court.hall.translate(STEP)).transform.offset[0]
        assert moved == await court.where()

    held(5, main)


@pytest.mark.parametrize("commits", [1, 2, 3])
def test_who_is_asked_first_dies_at_a_write_and_it_is_done_once(commits: int) -> None:
    """Behind its promise, its vote, or the decision."""

    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        await trio.sleep(3.0)
        court.cluster.net.trap(court.cluster.nodes[0].address, Point.AFTER_COMMIT, commits, lambda: court.crash(0))
        await court.hall.translate(STEP)
        assert await court.where() == 1.0
        await court.start(0)
        await trio.sleep(30.0)
        assert await court.where() == 1.0
        await court.hall.translate(STEP)
        assert await court.where() == 2.0

    held(3, main)


def test_all_who_decided_at_first_may_be_replaced() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        for slot in (3, 4):
            await court.scene.add_participants([court.entry(slot)])
        for slot in (0, 1):
            await court.scene.remove_participant(*court.ids(slot))
        with pytest.raises(LocalFault, match="does not decide"):
            await court.scene.remove_participant(*court.ids(0))
        assert (await court.scene.deciders()).nodes == court.ids(2, 3, 4)
        await court.hall.translate(STEP)
        court.crash(1)
        fresh = await court.client.scenes.open("kitchen")
        assert (await (await fresh.space_named("hall")).info()).transform.offset[0] == 1.0
        await court.hall.translate(STEP)
        kinds = [type(entry.record.entry).__name__ for entry in (await fresh.log()).entries]
        assert kinds[2:] == ["AddParticipant"] * 2 + ["RemoveParticipant"] * 2 + ["TranslateSpace"] * 2

    held(5, main)


def test_what_nobody_answered_for_is_told_later_by_anybody() -> None:
    async def main(court: Court) -> None:
        await court.create(0, 1, 2)
        known = (await court.scene.access.read_log()).state.requests
        (request,) = (request for request, position in known.items() if position == 2)
        assert (await court.scene.standing(request, 2)).position == 2
        assert (await court.scene.standing(bytes(16), 3)).document()["outcome"] == "open"
        await court.hall.translate(STEP)
        assert (await court.scene.standing(bytes(16), 3)).document()["outcome"] == "never"
        court.crash(1, 2)
        with pytest.raises((Refused, Unreachable)):
            await court.scene.standing(bytes(16), 4)

    held(3, main)


def test_a_creation_whose_answer_is_lost_is_found() -> None:
    async def main(court: Court) -> None:
        entries = [court.entry(slot) for slot in (0, 1, 2)]
        court.cluster.net.trap(court.cluster.nodes[0].address, Point.AFTER_COMMIT, 1, lambda: court.crash(0))
        with pytest.raises(Unreachable, match="may have happened"):
            await court.client.scenes.create("kitchen", participants=entries)
        await court.start(0)
        with pytest.raises(LocalFault, match="exists already"):
            await court.client.scenes.create("kitchen", participants=entries)
        scene = await court.client.scenes.open("kitchen")
        assert len((await scene.deciders()).participants) == 3
        await scene.create_space("hall", BOX)

    held(3, main)
