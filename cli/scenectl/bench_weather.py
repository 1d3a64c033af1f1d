"""What `bench store --weather` does: how long single reads take while a disk is slow, while a node is dead, and while copies are mended.

Reads begin at times of their own, however long others take, so that waiting in line is counted, too; each is of one record, and every
answer is compared with what was written. All is held against reads of the same minutes in calm: of a percentile alone, on a machine that
does other things as well, nobody can say whether it is good.
"""

from __future__ import annotations

import random
import shutil
import statistics
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

import trio

from scenectl.output import table
from scenectl.slow_node import slow_file_of

if TYPE_CHECKING:
    from scenectl.bench_store import StoreWork
    from scenefold.client import Cluster
    from scenefold.node.local import LocalCluster

NODE = "scenectl.slow_node"
"""What the nodes run, so that the disk of one can be made slow."""
TRANSFER = 4 * 1024 * 1024
"""Bytes a second that each node may move: the default, 64 MiB, is made for nodes with a machine each, and here all of them share one.

At that default GOAL is missed while copies are made anew (docs/benchmarks.md, Store).
"""
OPTIONS = ("--remove-after", "20", "--transfer", str(TRANSFER))
"""Two minutes elsewhere: that would show the same reads six times as long."""
FIRST = 1 << 34
"""The number of the first record that is read."""
RECORDS = 1_024
READS_PER_S = 60.0
WARM_S = 3.0
CALM_S = 12.0
SLOW_S = 15.0
SLOW_DISK_S = 0.25
"""What each look at a slow disk takes: it reads a sector some dozens of times before it has it."""
REMOVED_S_MAX = 90.0
MENDED_S_MAX = 300.0
LOOK_S = 1.0
READ_S_MAX = 30.0
"""A read that has no answer by then has failed."""
GOAL = 3.0
"""The 99th percentile in a storm, over that in calm."""
CALM = "calm"
_FAILURES_TOLD = 3


class Reader:
    """Reads records that are there, one by one, and notes how long each took."""

    def __init__(self, check: Callable[[Sequence[int]], Awaitable[None]], numbers: Sequence[int]) -> None:
        self._check = check
        self._numbers = numbers
        self._dice = random.Random(len(numbers))
        self.waits_s: list[float] = []
        self.failures: Counter[str] = Counter()

    async def run(self, reads: trio.Nursery) -> None:
        """Begin reads in `reads`, unevenly, as strangers come, until cancelled."""
        due_at = trio.current_time()
        while True:
            await trio.sleep_until(due_at)
            reads.start_soon(self._read, self._dice.choice(self._numbers), due_at)
            due_at += self._dice.expovariate(READS_PER_S)

    async def _read(self, number: int, due_at: float) -> None:
        from scenefold.base.errors import Refused, Unreachable

        with trio.CancelScope(deadline=due_at + READ_S_MAX):
            try:
                await self._check([number])
                self.waits_s.append(trio.current_time() - due_at)
            except (Refused, Unreachable) as problem:
                self.failures[problem.what] += 1
            return
        self.failures[f"no answer within {READ_S_MAX:g} s"] += 1


async def weather(nodes: LocalCluster, work: StoreWork) -> dict[str, Any]:
    """All phases, on a cluster whose nodes run NODE; the report. The last node is the one that suffers, since the first alone votes."""
    from scenefold.client import connect

    await work.write(RECORDS, READ_S_MAX)
    # Who asks how it stands is another client, or the one that reads would learn from it.
    async with connect(nodes.profile) as watcher, trio.open_nursery() as reads:
        storm, victim, records = _Storm(work, reads), nodes.addresses[-1], await _owned(watcher)
        await storm.phase("", partial(trio.sleep, WARM_S))
        await storm.phase(CALM, partial(trio.sleep, CALM_S))
        with slow_disk(nodes, victim):
            await storm.phase("slow disk", partial(trio.sleep, SLOW_S))
        await storm.phase("", partial(trio.sleep, WARM_S))
        await storm.phase(CALM, partial(trio.sleep, CALM_S))
        await nodes.kill(victim)
        await storm.phase("dead node", partial(_until, partial(_is_removed, watcher, victim), REMOVED_S_MAX))
        await storm.phase("repair", partial(_until, partial(_is_whole, watcher, records), MENDED_S_MAX))
        shutil.rmtree(nodes.folder / "data" / victim)
        nodes.start(victim)
        await storm.phase("newcomer", partial(_until, partial(_has_come, watcher, victim, records), MENDED_S_MAX))
    return storm.report()


class _Storm:
    """Reads, phase after phase, without a pause between them."""

    def __init__(self, work: StoreWork, reads: trio.Nursery) -> None:
        self._work = work
        self._reads = reads
        self._phases: list[tuple[str, Reader, float]] = []

    async def phase(self, name: str, until: Callable[[], Awaitable[object]]) -> None:
        """Read until then. What has begun by then counts, however long it takes. A phase without a name counts for nothing."""
        from scenefold.world import background_tasks

        reader, begun = Reader(self._work.check, range(FIRST, FIRST + RECORDS)), time.monotonic()
        async with background_tasks() as pacing:
            pacing.start_soon(reader.run, self._reads)
            await until()
        if name:
            self._phases.append((name, reader, time.monotonic() - begun))

    def report(self) -> dict[str, Any]:
        """By name of phase, the two of calm as one."""
        names = list(dict.fromkeys(name for name, _, _ in self._phases))
        rows = [_row(name, [(reader, seconds) for other, reader, seconds in self._phases if other == name]) for name in names]
        calm = next(row["p99_ms"] for row in rows if row["phase"] == CALM)
        phases = [{**row, "of_calm": row["p99_ms"] / calm if calm and row["p99_ms"] is not None else None} for row in rows]
        return {"reads_per_s": READS_PER_S, "goal": GOAL, "phases": phases}


@contextmanager
def slow_disk(nodes: LocalCluster, address: str) -> Iterator[None]:
    """The disk of one node is slow."""
    file = slow_file_of(nodes.folder / "data" / address)
    file.write_text(f"{SLOW_DISK_S}")
    try:
        yield
    finally:
        file.unlink()


async def _until(is_so: Callable[[], Awaitable[bool]], seconds: float) -> None:
    with trio.move_on_after(seconds):
        while True:
            if await is_so():
                return
            await trio.sleep(LOOK_S)


async def _is_removed(watcher: Cluster, address: str) -> bool:
    return all(node.address != address for node in await watcher.nodes())


async def _has_come(watcher: Cluster, address: str, records: int) -> bool:
    """Whether a node owns something, and nothing is on its way any more."""
    owning = {node.address for node in await watcher.nodes() if node.right_bound is not None}
    return address in owning and await _is_whole(watcher, records)


async def _is_whole(watcher: Cluster, records: int) -> bool:
    """Whether so many records are owned, and all copies where they should be, by what the nodes say that are left."""
    from scenefold.client.reports import NodeReport

    owned = 0
    for report in (await watcher.reports()).values():
        if not isinstance(report, NodeReport) or report.copies is None:
            return False
        copies = report.copies
        owned += copies.owned
        amiss = (copies.under_copied, copies.mis_placed, copies.forbidden, copies.comparing)
        if any(part.records or part.segments for part in amiss) or copies.owed or copies.unsettled or copies.unrecovered:
            return False
    # Of what nobody owns yet nobody says that it is amiss.
    return owned >= records


async def _owned(watcher: Cluster) -> int:
    """Records of all nodes."""
    return (await watcher.health()).records


def _row(name: str, parts: Sequence[tuple[Reader, float]]) -> dict[str, Any]:
    waits_s = [wait for reader, _ in parts for wait in reader.waits_s]
    failures: Counter[str] = sum((reader.failures for reader, _ in parts), Counter())
    cuts = statistics.quantiles(waits_s, n=100, method="inclusive") if len(waits_s) > 1 else None
    return {
        "phase": name,
        "seconds": sum(seconds for _, seconds in parts),
        "reads": len(waits_s),
        "failed": failures.total(),
        "failures": dict(failures.most_common(_FAILURES_TOLD)),
        "p50_ms": None if cuts is None else 1000 * cuts[49],
        "p99_ms": None if cuts is None else 1000 * cuts[98],
        "most_ms": 1000 * max(waits_s, default=0.0),
    }


def weather_text(report: dict[str, Any]) -> str:
    """The report for people."""

    def number(value: float | None, places: int = 1) -> str:
        return "" if value is None else f"{value:,.{places}f}"

    rows = [
        (
            row["phase"],
            number(row["seconds"], 0),
            f"{row['reads']:,}",
            f"{row['failed']:,}",
            *(number(row[key]) for key in ("p50_ms", "p99_ms", "most_ms", "of_calm")),
        )
        for row in report["phases"]
    ]
    heads = ("single reads of 8 KiB", "seconds", "reads", "failed", "median ms", "99 % ms", "most ms", "99 % of calm")
    return f"{table(heads, rows)}\ngoal: {report['goal']:g} times as long as in calm"
