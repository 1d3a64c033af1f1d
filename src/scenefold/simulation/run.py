"""One run: found a cluster, let clients work, let the storm rage, let it calm down, and judge (specs/17-simulation.md, Runs).

0 s     founders start
        clients begin once the line is tiled
4 s …   the storm: faults of the schedule, clients at work
        everything heals; clients work on for a while
        quiet, or patience ends; everything is read once more; histories are judged
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from contextlib import AsyncExitStack, ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import trio

from scenefold.client.scene import Scene
from scenefold.scene.layout import META
from scenefold.simulation import laws
from scenefold.simulation.asking import Asker
from scenefold.simulation.calm import Unrest, unrest
from scenefold.simulation.clients import Client, MemoryKeyring, keep_copies, open_client, secrets_of
from scenefold.simulation.cluster import HABITS, Cluster, Habits, key_of
from scenefold.simulation.faults import CLIENTS, Schedule
from scenefold.simulation.final import judge_histories, read_everything
from scenefold.simulation.leaving import drain
from scenefold.simulation.log_drama import LogDrama
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.mutants import mutated
from scenefold.simulation.noted import judge_notes
from scenefold.simulation.outcome import OPERATIONS_MIN, Order, Result
from scenefold.simulation.proof import prove_copies
from scenefold.simulation.purging import Purges
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.render_small import small_passes
from scenefold.simulation.rotating import KeyChanges
from scenefold.simulation.senate import Senate
from scenefold.simulation.speed import quick_headers, quick_packets, remembered_signatures
from scenefold.simulation.storm import Storm
from scenefold.simulation.story import Violation, told
from scenefold.simulation.turning import CopiesChanges
from scenefold.simulation.weather import spares_of
from scenefold.simulation.whole import judge_store, judge_stores
from scenefold.simulation.workload import SINGLE, WITH_COPIES, Tally, Worker, client_name, draw_places
from scenefold.world import open_links
from scenefold.world.sim import SimNet, Trace, run_simulated

if TYPE_CHECKING:
    from scenefold.simulation.render_drama import RenderDrama

START_S_MAX = 60.0
AFTERMATH_S = 6.0
"""Clients work on for so long after everything has healed: what a fault broke often shows only then."""
ENOUGH_S_MAX = 240.0
"""After a storm in which hardly anybody could be served clients work on until there is something to judge."""
QUIET_S_MAX = 240.0
"""Removing, waiting for leases, adopting, joining again and offering strays take about a minute; twice that, twice over."""
QUIET_CHECKS = 3
"""Quiet is what lasts for so many seconds."""
LINGER_S_MAX = 30.0
"""Acts that have begun end within this time."""
EARLY_S = 0.5
"""Between two looks of whoever waits for a violation."""
DEPTH_TOLD = 6
"""Frames of a failure that a story shows."""
VIRTUAL_S_MAX = 2_000.0
STEPS_MAX = 4_000_000


def run(order: Order) -> Result:
    """Run one seed, in this process."""
    begin = time.process_time()
    schedule = order.schedule
    with ExitStack() as stack:
        stack.enter_context(quiet_logs())
        stack.enter_context(remembered_signatures())
        stack.enter_context(mutated(order.mutant))
        stack.enter_context(small_passes(wanted=order.workload == "renders"))
        stack.enter_context(quick_packets())
        stack.enter_context(quick_headers())
        file = stack.enter_context(Path(order.trace_file).open("w")) if order.trace_file else None
        drama = _Drama(order, schedule, Trace(keep=0, file=file))
        try:
            run_simulated(order.seed, drama.play, virtual_s_max=VIRTUAL_S_MAX, steps_max=STEPS_MAX)
        except Exception as problem:  # noqa: BLE001  a bug in an event, too, is a finding of this seed, and ends no other
            drama.broke_off(problem)
    return drama.result(time.process_time() - begin)


class _Drama:
    """The course of one run."""

    def __init__(self, order: Order, schedule: Schedule, trace: Trace) -> None:
        self._order = order
        self._schedule = schedule
        self._net = SimNet(order.seed, trace=trace)
        self._cluster: Cluster | None = None
        self._storm: Storm | None = None
        self._logs: LogDrama | None = None
        """In the workload `logs`."""
        self._renders: RenderDrama | None = None
        """In the workload `renders`."""
        self._tally = Tally()
        self._operations: int | None = None
        """Acknowledged by the end of the clients' work: what the judge reads afterwards is not counted."""
        self._broken: list[Violation] = []
        self._places = draw_places(order.seed, order.nodes)

    async def play(self) -> None:
        """Everything, from founding to judging."""
        async with trio.open_nursery() as nursery:
            spares = max(spares_of(self._schedule, self._order.nodes), default=self._order.nodes - 1) + 1 - self._order.nodes
            cluster = self._cluster = Cluster(self._net, self._order.nodes, spares, nursery, self._habits())
            cluster.on_death = partial(judge_store, cluster)
            if self._order.voters > 1:
                senate = Senate(cluster, self._order.voters)
                cluster.has_several_voters, cluster.may_lose, cluster.voters_missing = True, senate.may_lose, senate.missing
                cluster.extensions = (senate,)
            if self._order.workload == "renders":
                self._renders = self._render_drama(cluster)
            for slot in range(self._order.nodes):
                cluster.start(slot)
            nursery.start_soon(watch_removals, cluster)
            if self._order.until:
                nursery.start_soon(self._end_early, cluster, nursery.cancel_scope)
            if await self._until(lambda: not unrest(cluster), START_S_MAX):
                async with AsyncExitStack() as stack:
                    clients = await self._open_clients(stack, cluster)
                    if self._order.workload == "logs":
                        self._logs = LogDrama(cluster, self._order)
                        await self._logs.begin(clients, partial(_nonsense_heard, cluster))
                    if self._renders is not None:
                        await self._renders.begin(clients, nursery)
                    await self._rage(cluster, clients)
                    await self._settle(cluster, clients)
            else:
                self._complain(cluster, unrest(cluster))
            nursery.cancel_scope.cancel()

    async def _end_early(self, cluster: Cluster, scope: trio.CancelScope) -> None:
        while all(found.law != self._order.until for found in cluster.watch.violations):  # noqa: ASYNC110 - whoever finds one tells nobody
            await trio.sleep(EARLY_S)
        scope.cancel()

    def _habits(self) -> Habits:
        if self._order.workload == "logs":
            # Who is removed over a long silence decides no more, and most of the participants may be silent for as long.
            return replace(HABITS, copying=self._order.copying, remove_after_s=None)
        return replace(HABITS, copying=self._order.copying)

    def _render_drama(self, cluster: Cluster) -> RenderDrama:
        """Imported late: no other workload needs what renders."""
        from scenefold.simulation.render_drama import RenderDrama

        return RenderDrama(cluster, self._order)

    async def _open_clients(self, stack: AsyncExitStack, cluster: Cluster) -> list[Client]:
        keyring, writer = MemoryKeyring(), key_of(self._order.seed, "the writer")
        clients: list[Client] = []
        for number in range(CLIENTS):
            name = client_name(number)
            opening = open_client(name.partition(":")[2], self._net.world(name), cluster.facts, keyring, writer, cluster.watch.recorder)
            client = await stack.enter_async_context(opening)
            client.scene = await client.scenes.open_or_create("simulated", copies=1)
            if not clients and self._order.copying is not None:
                await keep_copies(client.scene, self._order.copying, cluster.watch)
            clients.append(client)
        return clients

    async def _rage(self, cluster: Cluster, clients: list[Client]) -> None:
        """The storm, with clients at work."""
        async with trio.open_nursery() as work:
            at_work = [] if self._logs is not None or self._renders is not None else clients
            workers = [self._worker(cluster, client, client.scene) for client in at_work if client.scene is not None]
            stop = trio.Event()
            if self._logs is not None:
                self._logs.start(work, stop)
            if self._renders is not None:
                self._renders.start(work, stop)
            for worker in workers:
                work.start_soon(worker.run, stop)
            if self._order.workload == "keys" and clients[-1].scene is not None:
                seed, nonsense = self._order.seed, _nonsense_heard(cluster, clients[-1])
                guest = secrets_of(key_of(seed, "the guest"))
                work.start_soon(KeyChanges(clients[-1].scene, seed, guest, self._tally, nonsense).run, stop)
            if self._order.workload == "turns" and clients[-1].scene is not None and self._order.copying is not None:
                scene, nonsense = clients[-1].scene, _nonsense_heard(cluster, clients[-1])
                changes = CopiesChanges(scene, self._order.seed, self._order.copying, cluster.watch, self._tally, nonsense)
                work.start_soon(changes.run, stop)
            if self._order.workload == "purges" and clients[-1].scene is not None:
                purges = Purges(clients[-1].scene, self._order.seed, self._tally, _nonsense_heard(cluster, clients[-1]))
                work.start_soon(purges.run, stop)
            async with trio.open_nursery() as faults:
                if clients[0].scene is not None:
                    faults.start_soon(self._ask, cluster, clients[0].scene)
                storm = self._storm = Storm(cluster, lambda node: drain(clients[0], node), faults, clients)
                for fault in self._schedule:
                    faults.start_soon(storm.befall, fault)
                await trio.sleep_until(self._order.storm_s)
                storm.end()
                faults.cancel_scope.cancel()
            for slot, node in cluster.nodes.items():
                if node.born.is_set() and not node.is_wanted and not node.has_left and not node.is_lost:
                    await node.gone.wait()
                    cluster.start(slot)
            await trio.sleep(AFTERMATH_S)
            await self._until(lambda: self._is_enough(cluster), ENOUGH_S_MAX)
            stop.set()
        self._operations = cluster.watch.recorder.acknowledged

    def _is_enough(self, cluster: Cluster) -> bool:
        """Whether there is something to judge."""
        if self._logs is not None:
            return self._logs.is_enough
        if self._renders is not None:
            return self._renders.is_enough
        return cluster.watch.recorder.acknowledged >= OPERATIONS_MIN

    async def _ask(self, cluster: Cluster, scene: Scene) -> None:
        """Somebody whose questions must be answered as long as owners live."""
        async with open_links(self._net.world("user:asker")) as links:
            await Asker(cluster, links, scene, META, [*self._places.hot, *self._places.wide]).run()

    def _worker(self, cluster: Cluster, client: Client, scene: Scene) -> Worker:
        nonsense = _nonsense_heard(cluster, client)
        pairs = WITH_COPIES if self._order.copies else SINGLE
        return Worker(client.name, scene, self._places, self._order.seed, self._order.workload, self._tally, nonsense, pairs)

    async def _settle(self, cluster: Cluster, clients: list[Client]) -> None:
        """Wait for quiet, read everything, judge."""
        if await self._until(lambda: not unrest(cluster), QUIET_S_MAX, checks=QUIET_CHECKS):
            cluster.watch.homecoming.judge_rest()
            if clients[0].scene is not None:
                await prove_copies(cluster, clients[0].scene)
            judge_stores(cluster)
            judge_notes(cluster)
        else:
            self._complain(cluster, unrest(cluster))
        if self._logs is not None:
            await self._logs.settle()
        if self._renders is not None:
            await self._renders.settle()
        await read_everything(cluster.watch, clients[0])
        judge_histories(cluster.watch)
        for words in self._tally.wrong:
            cluster.watch.violated(laws.SOUND, words)
        for place, words in cluster.watch.recorder.strange:
            cluster.watch.violated(laws.LINEARIZABLE, words, location=place.location)

    async def _until(self, holds: Callable[[], bool], seconds: float, *, checks: int = 1) -> bool:
        """Whether something holds, looked at once a second, for so many times in a row, within this time."""
        lasting = 0
        with trio.move_on_after(seconds):
            while lasting < checks:
                await trio.sleep(1.0)
                lasting = lasting + 1 if holds() else 0
        return lasting >= checks

    def _complain(self, cluster: Cluster, wrong: list[Unrest]) -> None:
        for law, what, slots in wrong[:5]:
            cluster.watch.violated(law, what, slots=slots)

    def broke_off(self, problem: BaseException) -> None:
        """The run itself did not come to its end."""
        first = problem
        while isinstance(first, BaseExceptionGroup | trio.TrioInternalError):
            # What is raised in the midst of Trio's own loop comes wrapped by that.
            inner = first.exceptions[0] if isinstance(first, BaseExceptionGroup) else first.__cause__
            if inner is None:
                break
            first = inner
        where = "".join(traceback.format_exception(first)[-DEPTH_TOLD:])
        self._broken.append(Violation(laws.SOUND, f"{type(first).__name__}: {first}\n{where}"[:4000], self._net.now))

    def result(self, cpu_s: float) -> Result:
        """What it came to."""
        watch = None if self._cluster is None else self._cluster.watch
        violations = (*([] if watch is None else watch.violations), *self._broken)
        counts = {} if watch is None else dict(watch.counts)
        lies = None if watch is None else watch.recorder.lies
        if lies is not None and lies.told:
            counts["lies"] = lies.told.total()
        acknowledged = 0 if watch is None else watch.recorder.acknowledged
        story = ""
        if violations and watch is not None:
            numbers = range(len(self._schedule)) if self._order.keep is None else self._order.keep
            lines = watch.story.about(violations[0])
            story = told(self._order.seed, self._schedule, numbers, violations, lines, self._order.replay)
        return Result(
            order=self._order,
            schedule=self._schedule,
            violations=violations,
            faults={} if self._storm is None else dict(self._storm.happened),
            operations=acknowledged if self._operations is None else self._operations,
            trace_hash=self._net.trace.hash,
            virtual_s=self._net.now,
            cpu_s=cpu_s,
            counts=counts,
            reported={} if lies is None else dict(lies.reported),
            story=story,
            proposals=None if self._logs is None else self._logs.proposals,
            renders=None if self._renders is None else self._renders.renders,
        )


def _nonsense_heard(cluster: Cluster, client: Client) -> Callable[[], int]:
    """How many answers with nonsense a client was given."""
    return lambda: cluster.watch.recorder.nonsense_heard[client.name]
