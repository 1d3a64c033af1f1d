"""What `bench log` does: how fast participants decide what their owners ask for, and how soon after the death of one of them.

A scene of its own for each measurement, in a cluster of exactly those who decide: a value holds its scene's whole sealed log, so it grows, and
whoever does not decide is told of each header. A scene takes so many changes at once, and then two a second (specs/16-scene-log.md);
no measurement asks for more.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import trio

from scenectl.bench_killed import killed
from scenectl.bench_store import clock_of
from scenectl.output import table

if TYPE_CHECKING:
    from scenefold.client import Cluster
    from scenefold.client.scene import Scene
    from scenefold.client.scene_log import ReadLog
    from scenefold.node.local import LocalCluster
    from scenefold.world import Ports

GOAL_S = 5.0
"""From the death of who proposes to the next change that is acknowledged."""
SPACE = "bench"


@dataclass(frozen=True, kw_only=True)
class LogBench:
    """What to measure."""

    participants: Sequence[int]
    """Numbers of them, a cluster for each."""
    commits: int
    clients: int
    kills: int


@dataclass
class Turn:
    """One measurement: how long each change took, and what else became of some."""

    waits_s: list[float] = field(default_factory=list)
    refused: int = 0
    unknown: int = 0
    seconds: float = 0.0
    cpu_s: float | None = None
    packets: int = 0

    async def one(self, change: Callable[[], Awaitable[object]]) -> None:
        from scenefold.base.errors import Refused, Unreachable

        asked = time.monotonic()
        try:
            await change()
        except Refused:
            self.refused += 1
        except Unreachable:
            self.unknown += 1
        else:
            self.waits_s.append(time.monotonic() - asked)

    def document(self) -> dict[str, Any]:
        done = len(self.waits_s)
        return {
            "commits": done,
            "refused": self.refused,
            "unknown": self.unknown,
            "commits_per_s": done / self.seconds if self.seconds else 0.0,
            "p50_ms": None if not done else 1000 * part(self.waits_s, 50),
            "p99_ms": None if not done else 1000 * part(self.waits_s, 99),
            "packets_per_commit": None if not done else self.packets / done,
            "cpu_ms_per_commit": None if not done or self.cpu_s is None else 1000 * self.cpu_s / done,
        }


class Owner:
    """Somebody who moves a space of a scene, a little each time."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    async def change(self) -> ReadLog:
        from scenefold.wire import TranslateSpace

        return await self.scene.access.change_log(lambda log: TranslateSpace(log.named(SPACE).id, (0.5, 0.0, 0.0)))


class Bench:
    """One cluster, all of whose nodes decide."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster, count: int) -> None:
        self.nodes, self.cluster, self.count = nodes, cluster, count
        self._cpu_s = clock_of(nodes)

    async def owner(self) -> Owner:
        """Of a new scene, which they decide from now on."""
        scene = await self.cluster.scenes.create(f"bench-{os.urandom(4).hex()}", copies=1, participants=self.count)
        await scene.create_space(SPACE, copies=1)
        return Owner(scene)

    async def other(self, owner: Owner, stack: AsyncExitStack) -> Owner:
        """The same scene, with a connection of its own."""
        from scenefold.client import connect

        cluster = await stack.enter_async_context(connect(self.nodes.profile))
        other = Owner(await cluster.scenes.open(owner.scene.name))
        await other.scene.access.read_log()
        return other

    async def turn(self, owners: Sequence[Owner], commits: int) -> dict[str, Any]:
        """Each owner asks for one change after the other, until there are so many."""
        turn, left = Turn(), iter(range(commits))

        async def ask(owner: Owner, left: Iterator[int]) -> None:
            for _ in left:
                await turn.one(owner.change)

        async with self._counted(turn), trio.open_nursery() as nursery:
            for owner in owners:
                nursery.start_soon(ask, owner, left)
        return turn.document()

    @asynccontextmanager
    async def _counted(self, turn: Turn) -> AsyncIterator[None]:
        packets, cpu_s, begun = await self._packets(), self._cpu_s(), time.monotonic()
        yield
        turn.seconds, spent = time.monotonic() - begun, self._cpu_s()
        turn.cpu_s = None if cpu_s is None or spent is None else spent - cpu_s
        turn.packets = await self._packets() - packets

    async def _packets(self) -> int:
        """That all nodes together have sent about logs. Raises what kept one of them from saying: no answer is no count of zero."""
        from scenefold.base.errors import ScenefoldError

        total = 0
        for report in (await self.cluster.reports()).values():
            if isinstance(report, ScenefoldError):
                raise report
            total += report.log_packets
        return total


async def bench_log(bench: LogBench, ports: Ports | None) -> list[dict[str, Any]]:
    """A row for each number of participants, real processes (docs/reference/scenectl.md)."""
    return [await _of(bench, count, ports) for count in bench.participants]


async def _of(bench: LogBench, count: int, ports: Ports | None) -> dict[str, Any]:
    from scenefold.client import connect
    from scenefold.node.local import local_cluster

    async with AsyncExitStack() as stack:
        nodes = await stack.enter_async_context(local_cluster(count, ports=ports, trust=True))
        it = Bench(nodes, await stack.enter_async_context(connect(nodes.profile)), count)
        alone = await it.owner()
        await alone.change()
        row: dict[str, Any] = {"participants": count, "one_client": await it.turn([alone], bench.commits)}
        shared = await it.owner()
        others = [await it.other(shared, stack) for _ in range(bench.clients - 1)]
        row["one_scene"] = await it.turn([shared, *others], bench.commits)
        row["a_scene_each"] = await it.turn([await it.owner() for _ in range(bench.clients)], bench.commits)
        if bench.kills and count > 2:
            owner = await it.owner()
            row["killed"] = await killed(nodes, owner.change, (await it.other(owner, stack)).change, bench.kills, GOAL_S)
        return row


def simulated_rows(counts: Sequence[int], commits: int) -> list[dict[str, Any]]:
    """A row for each number of participants, in virtual time."""
    if not counts:
        return []
    from scenefold.simulation.log_latency import measure

    return [measure(count, commits) for count in counts]


def part(waits_s: Sequence[float], percent: int) -> float:
    """So long, or less, took this part of all."""
    return waits_s[0] if len(waits_s) == 1 else statistics.quantiles(waits_s, n=100, method="inclusive")[percent - 1]


def bench_text(report: dict[str, Any]) -> str:
    """The report for people."""

    def number(value: float | None, places: int = 0) -> str:
        return "" if value is None else f"{value:,.{places}f}"

    ways = {"one_client": "one client", "one_scene": "{clients} clients, one scene", "a_scene_each": "{clients} clients, a scene each"}
    rows = [
        (
            f"{row['participants']}",
            name.format(clients=report["clients"]),
            number(turn["commits_per_s"], 1),
            *(number(turn[key]) for key in ("p50_ms", "p99_ms", "packets_per_commit", "cpu_ms_per_commit")),
            f"{turn['refused']} and {turn['unknown']} of {turn['commits'] + turn['refused'] + turn['unknown']}",
        )
        for row in report["participants"]
        for way, name in ways.items()
        for turn in [row[way]]
    ]
    heads = ("participants", "who asks", "commits/s", "median ms", "99 % ms", "packets", "processor ms", "refused and unknown")
    told = [table(heads, rows)] if rows else []
    told += [_killed_text(row["participants"], row["killed"]) for row in report["participants"] if "killed" in row]
    told += [
        f"{row['participants']} participants, simulated, {row['link_ms']:g} ms a link: {row['commits_per_s']:,.0f} commits/s, "
        f"median {row['p50_ms']:,.0f} ms, 99 % {row['p99_ms']:,.0f} ms, {row['packets_per_commit']:,.0f} packets a commit"
        for row in report["simulated"]
    ]
    return "\n".join(told)


def _killed_text(count: int, found: dict[str, Any]) -> str:
    waits = ", ".join(f"{wait:.2f}" for wait in found["next_commit_s"])
    verdict = "reached" if found["is_reached"] else "missed"
    return f"{count} participants, who proposes killed: next commit after {waits} s (goal: {found['goal_s']:g} s, {verdict})"
