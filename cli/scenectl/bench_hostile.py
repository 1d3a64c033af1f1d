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
from contextlib import AsyncExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import trio

from scenectl.output import table

if TYPE_CHECKING:
    from scenefold.base.location import Location
    from scenefold.client import Cluster, Scene, Space
    from scenefold.node.local import LocalCluster
    from scenefold.world import Ports

BATCH = 32
RECORD_BYTES = 1024
SPACE = 10
REST_S = 1.0
"""From the beginning of an attack, or of the burning, until it is measured: limits let a burst of anything through."""
ANSWER_S_MAX = 30.0
"""For the node that is or was attacked to say what it counted."""
LOOK_S = 0.2
FRAME_S = 2
"""So long the nodes wait for the rest of a frame, that an attack meets this limit within a turn of its own; else it is a minute."""
NODE = "scenectl.attacks.node"
OPTIONS = ("--frame-s", str(FRAME_S))
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
    from scenectl.attacks import ATTACKS, BY_MEMBERS
    from scenefold.base.errors import LocalFault
    from scenefold.base.ids import SpaceId
    from scenefold.client import connect
    from scenefold.node.local import local_cluster

    if bench.nodes == 1 and any(name in BY_MEMBERS for name in bench.attacks):
        raise LocalFault("a member attacks another one, and this cluster has one node", remedy="--nodes 2")
    attacks = bench.attacks or [name for name in ATTACKS if bench.nodes > 1 or name not in BY_MEMBERS]
    async with AsyncExitStack() as stack:
        nodes = await stack.enter_async_context(local_cluster(bench.nodes, spares=1, ports=bench.ports, options=OPTIONS, module=NODE))
        cluster = await stack.enter_async_context(connect(nodes.profile))
        scene = await cluster.scenes.create("bench-hostile", copies=1)
        honest = Honest(scene.space(SpaceId(SPACE)), honest_places())
        alone = await honest.rate(bench.seconds)
        rows = [await _measure(bench, nodes, cluster, scene, honest, name) for name in attacks]
        return {
            "nodes": bench.nodes,
            "seconds": bench.seconds,
            "rounds": bench.rounds,
            "alone_records_per_second": alone,
            "attacks": rows,
            "wrong_bytes": honest.wrong,
            "failed_calls": honest.failed,
        }


def honest_places() -> list[Location]:
    """All over the line."""
    from scenefold.base.location import LINE_LENGTH, Location

    return [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * BATCH)) for index in range(BATCH)]


def aimed(nodes: LocalCluster, scene: Scene, name: str) -> dict[str, Any]:
    """The settings of an attack on the first node."""
    from scenectl.attacks.node import lie_of
    from scenefold.base.location import Location

    places = honest_places()
    return {
        "profile": str(nodes.profile),
        "address": nodes.addresses[0],
        "scene": scene.id,
        "scene_name": scene.name,
        "space": SPACE,
        "place": places[0].hex(),
        "far": Location.from_number(places[-1].number + 1).hex(),
        "lie": str(lie_of(nodes.folder / "data" / nodes.addresses[-1])),
        "attack": name,
    }


async def counted(cluster: Cluster, address: str) -> Counter[str]:
    """What a node has counted of what it did not take, since its start. Asks until it answers: no answer is no count of zero."""
    from scenefold.base.errors import Unreachable

    with trio.fail_after(ANSWER_S_MAX):
        while True:
            with suppress(Unreachable):
                for node in (await cluster.look()).nodes:
                    if node.address == address and (one := node.report) is not None:
                        return Counter({"turned away": one.turned_away, "datagrams dropped": one.dropped})
            await trio.sleep(LOOK_S)


async def _measure(bench: HostileBench, nodes: LocalCluster, cluster: Cluster, scene: Scene, honest: Honest, name: str) -> dict[str, Any]:
    from scenectl.attacks import LIARS
    from scenectl.attacks.running import attacking

    settings = aimed(nodes, scene, name)
    # The last node owns the last part of the line: whoever reads there is lied to, and others shall not be kept from theirs.
    honest.places = honest_places()[: BATCH // 2 if name in LIARS else BATCH]
    before, failed, grown = memory_bytes(nodes), honest.failed, 0
    node_counted = Counter[str]()
    seen, seconds, cpu_s = Counter[str](), 0.0, 0.0
    attacked: list[float] = []
    beside: list[float] = []
    cores: list[float] = []
    """Of the node that is attacked: beside the attack, less those beside the burner."""
    for _ in range(bench.rounds):
        counted_before = await counted(cluster, nodes.addresses[0])
        async with attacking(settings) as report:
            await trio.sleep(REST_S)
            with _cores_of(nodes) as under_attack:
                attacked.append(await honest.rate(bench.seconds))
            grown = max(grown, memory_bytes(nodes) - before)
        node_counted.update(await counted(cluster, nodes.addresses[0]) - counted_before)
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
        "node_counted": dict(sorted(node_counted.items())),
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
        did = ", ".join(f"{what} {rate:,.0f}/s" for what, rate in row["per_second"].items() if rate)
        did += "".join(f", {count:,} {what}" for what, count in row["node_counted"].items())
        growth = f"{row['memory_growth_bytes'] / (1 << 20):+.0f} MiB"
        low, high = row["relative_range"]
        relative = f"{row['relative']:.0%} ({low * 100:.0f} to {high * 100:.0f})"
        honest = f"{row['records_per_second']:,.0f}"
        rows.append((row["attack"], did, f"{row['attacker_cores']:.2f}", honest, relative, f"{row['node_cores']:.2f}", growth))
    heads = ("attack", "what happened", "cores", "honest records/s", "of beside a burner", "the node's cores", "memory")
    end = f"wrong bytes: {report['wrong_bytes']}; calls that failed: {report['failed_calls']}"
    return f"{table(heads, rows)}\n{end}"
