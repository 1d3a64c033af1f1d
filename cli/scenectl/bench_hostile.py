"""What `bench hostile` does: how honest work goes on while somebody attacks a node.

A cluster of processes; an honest client that writes and reads; and beside it, in turns, an attacker, and a process that burns as
much processor time as the attacker did, since on one machine that alone costs the honest ones something. Whatever the honest
client reads is compared with what it wrote.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trio

from scenectl.output import table

if TYPE_CHECKING:
    from scenefold.base.location import Location
    from scenefold.client import Scene, Space
    from scenefold.node.local import LocalCluster
    from scenefold.world import Ports

BATCH = 32
RECORD_BYTES = 1024
SPACE = 10
REST_S = 1.0
"""From the beginning of an attack, or of the burning, until it is measured: limits let a burst of anything through."""
_BURN = "import sys, time\nshare = float(sys.argv[1])\nwhile True:\n    end = time.process_time() + share / 50\n    while time.process_time() < end: pass\n    time.sleep((1 - share) / 50)\n"


@dataclass(frozen=True, kw_only=True)
class HostileBench:
    """What to measure."""

    attacks: Sequence[str]
    """Names; none: all."""
    seconds: float
    rounds: int
    """Turns of attack and burner; the median counts."""
    nodes: int
    ports: Ports | None


@dataclass
class Honest:
    """A client that writes and reads, and compares."""

    space: Space
    places: list[Location]
    turn: int = 0
    wrong: int = 0
    failed: int = 0

    async def rate(self, seconds: float) -> float:
        """Records written and read back a second."""
        from scenefold.base.errors import ScenefoldError

        done, begun = 0, time.monotonic()
        while time.monotonic() - begun < seconds:
            try:
                await self.work(1)
            except ScenefoldError:
                self.failed += 1
            else:
                done += len(self.places)
        return done / (time.monotonic() - begun)

    async def work(self, rounds: int) -> None:
        for _ in range(rounds):
            self.turn += 1
            payload = self.turn.to_bytes(8, "big") * (RECORD_BYTES // 8)
            await self.space.put_many([(place, payload) for place in self.places])
            found = await self.space.get_many(self.places)
            self.wrong += sum(one != payload for one in found)


async def bench_hostile(bench: HostileBench) -> dict[str, Any]:
    """Measure and return the report (docs/reference/scenectl.md)."""
    from scenectl.attacks import ATTACKS
    from scenefold.base.ids import SpaceId
    from scenefold.base.location import LINE_LENGTH, Location
    from scenefold.client import connect
    from scenefold.node.local import local_cluster

    async with AsyncExitStack() as stack:
        nodes = await stack.enter_async_context(local_cluster(bench.nodes, spares=1, ports=bench.ports))
        cluster = await stack.enter_async_context(connect(nodes.profile))
        scene = await cluster.scenes.create("bench-hostile")
        places = [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * BATCH)) for index in range(BATCH)]
        honest = Honest(scene.space(SpaceId(SPACE)), places)
        alone = await honest.rate(bench.seconds)
        rows = [await _measure(bench, nodes, scene, honest, name) for name in bench.attacks or ATTACKS]
        return {
            "nodes": bench.nodes,
            "seconds": bench.seconds,
            "rounds": bench.rounds,
            "alone_records_per_second": alone,
            "attacks": rows,
            "wrong_bytes": honest.wrong,
            "failed_calls": honest.failed,
        }


async def _measure(bench: HostileBench, nodes: LocalCluster, scene: Scene, honest: Honest, name: str) -> dict[str, Any]:
    from scenectl.attacks.running import attacking

    settings = {
        "profile": str(nodes.profile),
        "address": nodes.addresses[0],
        "scene": scene.id,
        "space": SPACE,
        "place": honest.places[0].hex(),
        "attack": name,
    }
    before, failed, grown = memory_bytes(nodes), honest.failed, 0
    seen, seconds, cpu_s = Counter[str](), 0.0, 0.0
    attacked: list[float] = []
    beside: list[float] = []
    cores: list[float] = []
    """Of the node that is attacked: beside the attack, less those beside the burner."""
    for _ in range(bench.rounds):
        async with attacking(settings) as report:
            await trio.sleep(REST_S)
            with _cores_of(nodes) as under_attack:
                attacked.append(await honest.rate(bench.seconds))
            grown = max(grown, memory_bytes(nodes) - before)
        seen.update(report.seen)
        seconds, cpu_s = seconds + report.seconds, cpu_s + report.cpu_s
        share = min(0.99, cpu_s / seconds)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(partial(trio.run_process, [sys.executable, "-c", _BURN, str(share)], check=False))
            await trio.sleep(REST_S)
            with _cores_of(nodes) as at_work:
                beside.append(await honest.rate(bench.seconds))
            nursery.cancel_scope.cancel()
        cores.append(under_attack[0] - at_work[0])
    ratios = [one / other if other else 0.0 for one, other in zip(attacked, beside, strict=True)]
    return {
        "attack": name,
        "seen": dict(sorted(seen.items())),
        "per_second": {what: count / seconds for what, count in sorted(seen.items())},
        "attacker_cores": cpu_s / seconds,
        "records_per_second": statistics.median(attacked),
        "beside_a_burner": statistics.median(beside),
        "relative": statistics.median(ratios),
        "relative_range": [min(ratios), max(ratios)],
        "node_cores": statistics.median(cores),
        "memory_growth_bytes": grown,
        "failed_calls": honest.failed - failed,
    }


@contextmanager
def _cores_of(nodes: LocalCluster) -> Iterator[list[float]]:
    """How many the first node used within this, in the end; 0 where the system does not say."""
    found: list[float] = []
    began, spent = time.monotonic(), _processor_s(nodes)
    yield found
    found.append((_processor_s(nodes) - spent) / (time.monotonic() - began))


def _processor_s(nodes: LocalCluster) -> float:
    stat = Path(f"/proc/{nodes.pid(nodes.addresses[0])}/stat")
    if not stat.exists():
        return 0.0
    user, system = stat.read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def memory_bytes(nodes: LocalCluster) -> int:
    """Resident, of all nodes; 0 where the system does not say."""
    total = 0
    for address in nodes.addresses:
        statm = Path(f"/proc/{nodes.pid(address)}/statm")
        if statm.exists():
            total += int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return total


def bench_text(report: dict[str, Any]) -> str:
    """The report for people."""
    rows = []
    for row in report["attacks"]:
        did = ", ".join(f"{what} {rate:,.0f}/s" for what, rate in row["per_second"].items())
        growth = f"{row['memory_growth_bytes'] / (1 << 20):+.0f} MiB"
        low, high = row["relative_range"]
        relative = f"{row['relative']:.0%} ({low * 100:.0f} to {high * 100:.0f})"
        honest = f"{row['records_per_second']:,.0f}"
        rows.append((row["attack"], did, f"{row['attacker_cores']:.2f}", honest, relative, f"{row['node_cores']:.2f}", growth))
    heads = ("attack", "what happened", "cores", "honest records/s", "of beside a burner", "the node's cores", "memory")
    end = f"wrong bytes: {report['wrong_bytes']}; calls that failed: {report['failed_calls']}"
    return f"{table(heads, rows)}\n{end}"
