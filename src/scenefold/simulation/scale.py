"""`python -m scenefold.simulation.scale --nodes 50|1000 [--only PART,...]`: how a large cluster does, in virtual time (specs/17-simulation.md).

One JSON object on stdout: messages and bytes a node and second by kind; seconds until a joiner's table is complete; seconds until
a dead node is removed; false removals under 2 % loss; how even fill is after one end of the line was loaded. All seconds are virtual but
`real_s`. With more than `FEW` nodes the cluster boots from prepared disks (scale_boot.py), loss lasts shorter, and nothing is balanced.
The exit code is 1, and stderr says why, if a law was violated or something that was waited for did not come (null in the JSON).
"""

from __future__ import annotations

import argparse
import gc
import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.location import LINE_LENGTH, Location
from scenefold.peer.balance.policy import TOLERANCE
from scenefold.scene.layout import META
from scenefold.simulation.calm import unrest
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, Habits, key_of
from scenefold.simulation.disks import arc_of, records_of
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.scale_boot import fill_tables, nothing_balanced, nothing_told_at_start, prepare
from scenefold.simulation.scale_traffic import counted
from scenefold.simulation.speed import quick_packets, remembered_signatures
from scenefold.simulation.usage import SEED_MAX, Parser, number
from scenefold.world.sim import CALM, SimNet, SimulationStuck, Trace, run_simulated

FEW = 100
LOSS = 0.02
HOUR_S = 3_600.0
LOOK_S = 0.05
FILL_LOOK_S = 10.0
"""Counting all records of all disks takes as long as much of what is counted."""
MEASURE_S = 60.0
SETTLE_S = 15.0
"""Until what a start or a join stirs up has passed."""
PARTS = ("traffic", "join", "removal", "balance", "loss")
START_S_MAX = 600.0
REMOVAL_S_MAX = 900.0
LOADED_RECORDS = 5_000
"""Balance leaves up to 64 KiB where it is at each bound: 5 % of fifty nodes' share must be more than two of these."""
LOADED_BYTES = 30_000
BALANCE_S_MAX = 3_600.0
VIRTUAL_S_MAX = 20_000.0
WALL_S_MAX = 7_200.0
"""The default of remove_after_s stands: this measures what people run."""


class Measurement:
    """A large cluster and what is measured on it, one thing after another."""

    def __init__(self, nodes: int, seed: int, parts: Sequence[str], loss_s: float, say: Callable[[str], None]) -> None:
        self.found: dict[str, Any] = {"nodes": nodes, "prepared": nodes > FEW}
        self._nodes = nodes
        self._parts = parts
        self._loss_s = loss_s
        self._net = SimNet(seed, trace=Trace(keep=0))
        self._say = say

    async def run(self) -> None:
        """Measure what is wanted, one thing after another."""
        steps = {"traffic": self._traffic, "join": self._join, "removal": self._removal, "balance": self._balance, "loss": self._loss}
        async with trio.open_nursery() as nursery:
            cluster = Cluster(self._net, self._nodes, 1, nursery, Habits(remove_after_s=None))
            nursery.start_soon(watch_removals, cluster)
            await (self._boot if self._nodes > FEW else self._start)(cluster)
            for part in self._parts:
                await trio.sleep(SETTLE_S)
                await steps[part](cluster)
            self.found["virtual_s"] = round(self._net.now, 1)
            self.found["violations"] = [violation.what for violation in cluster.watch.violations]
            nursery.cancel_scope.cancel()

    async def _start(self, cluster: Cluster) -> None:
        """For the first time, all at once."""
        with counted(self._net.trace, self._net.ports) as traffic:
            for slot in range(self._nodes):
                cluster.start(slot)
            await self._wait("start_s", lambda: not unrest(cluster), START_S_MAX)
        self.found["start_datagrams_per_node"] = round(traffic.messages["gossip"] / self._nodes, 1)
        self._say(f"{self._nodes} nodes stand after {self.found['start_s']} s")

    async def _boot(self, cluster: Cluster) -> None:
        """After a restart of all: with the log on every disk, and tables filled."""
        await prepare(cluster, self._nodes)
        self._say("disks are prepared")
        with nothing_told_at_start():
            for slot in range(self._nodes):
                cluster.start(slot)
            await self._wait("all_run_s", lambda: len(cluster.running) == self._nodes, START_S_MAX)
            fill_tables(cluster)
            self._say("tables are filled")
            await trio.sleep(2.5)
        held = await self._wait("leases_s", lambda: all(node.has_lease() for node in cluster.running.values()), START_S_MAX)
        # What stands now stays: the collector need not look at a million entries of tables again and again.
        gc.freeze()
        self._say(f"all hold leases after {held} s more")

    async def _wait(self, name: str, holds: Callable[[], bool], seconds: float, look_s: float = LOOK_S) -> float | None:
        """Note the virtual seconds until something holds; None if it does not in time."""
        begin = self._net.now
        self.found[name] = None
        while not holds():
            if self._net.now - begin > seconds:
                return None
            await trio.sleep(look_s)
        self.found[name] = round(self._net.now - begin, 2)
        return self.found[name]  # type: ignore[no-any-return]

    def problems(self) -> list[str]:
        """What is wrong with what was found, in words."""
        found = [f"violated: {what}" for what in self.found.get("violations", ())]
        return found + [f"did not come: {name}" for name, value in self.found.items() if value is None]

    async def _traffic(self, _cluster: Cluster) -> None:
        """What a node sends when nothing happens."""
        with counted(self._net.trace, self._net.ports) as traffic:
            await trio.sleep(MEASURE_S)
        self.found["a_node_and_second"] = traffic.a_node_and_second(self._nodes, MEASURE_S)
        self._say(f"a node and second: {self.found['a_node_and_second']}")

    async def _join(self, cluster: Cluster) -> None:
        """A spare is started: when does it know a status of every member?"""
        joiner = cluster.nodes[self._nodes]
        cluster.start(joiner.slot)

        def is_member() -> bool:
            return joiner.context is not None and joiner.context.cluster_log.registry.current(joiner.node_id) is not None

        def knows_all() -> bool:
            if joiner.context is None or not joiner.context.cluster_log.registry.position:
                return False
            registry, roster = joiner.context.cluster_log.registry, joiner.context.roster
            return len(list(roster.statuses())) >= len(registry.members) - 1

        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._wait, "table_complete_s", knows_all, START_S_MAX)
            nursery.start_soon(self._wait, "joiner_is_member_s", is_member, START_S_MAX)
        self._say(f"a joiner's table is complete after {self.found['table_complete_s']} s")

    async def _removal(self, cluster: Cluster) -> None:
        """A node dies without a word: when does the log remove it?"""
        victim = cluster.nodes[self._nodes // 2]
        before = cluster.watch.counts["removals"]
        with counted(self._net.trace, self._net.ports) as traffic:
            cluster.crash(victim.slot, silent=True)
            seconds = await self._wait("removal_s", lambda: cluster.watch.counts["removals"] > before, REMOVAL_S_MAX)
        if seconds:
            self.found["a_node_and_second_with_one_dead"] = traffic.a_node_and_second(self._nodes, seconds)
        self._say(f"a dead node is removed after {self.found['removal_s']} s")

    async def _loss(self, cluster: Cluster) -> None:
        """A long time in which two of a hundred packets are lost."""
        before = cluster.watch.counts["removals"]
        self._net.set_weather(replace(CALM, loss=LOSS))
        await trio.sleep(self._loss_s)
        self._net.set_weather(CALM)
        self.found["loss_s"] = self._loss_s
        self.found["false_removals"] = cluster.watch.counts["removals"] - before
        self._say(f"{self.found['false_removals']} removals in {self._loss_s:.0f} s of {LOSS:.0%} loss")

    async def _balance(self, cluster: Cluster) -> None:
        """Everything is written into the first hundredth of the line: when does every node hold the same within 5 %?"""
        keyring, writer = MemoryKeyring(), key_of(self._net.seed, "the writer")
        world = self._net.world("user:loader")
        async with open_client("loader", world, cluster.facts, keyring, writer, cluster.watch.recorder) as client:
            client.scene = await client.scenes.open_or_create("loaded", copies=1)
            await self._load(client)
        begin = self._net.now
        await self._wait("balance_s", lambda: self._is_even(cluster), BALANCE_S_MAX, FILL_LOOK_S)
        self.found["balance_spread"] = round(self._spread(cluster), 4)
        self.found["records_moved"] = cluster.watch.moves.count
        self._say(f"fill is within {self._spread(cluster):.1%} {self._net.now - begin:.0f} s after the load")

    async def _load(self, client: Client) -> None:
        assert client.scene is not None
        space = client.scene.space(META)
        step = LINE_LENGTH // 100 // LOADED_RECORDS
        places = [Location.from_number(index * step) for index in range(LOADED_RECORDS)]
        for start in range(0, LOADED_RECORDS, 100):
            payload = self._net.seed.to_bytes(8, "big") * (LOADED_BYTES // 8)
            await space.put_many([(place, payload) for place in places[start : start + 100]])

    def _is_even(self, cluster: Cluster) -> bool:
        spread = self._spread(cluster)
        self._say(f"fill is within {spread:.1%} at {self._net.now:.0f} s")
        return spread <= TOLERANCE

    def _spread(self, cluster: Cluster) -> float:
        """The largest distance of a member's fill from their mean, of the mean."""
        counts = [len(records_of(node.disk, arc)) for node in cluster.running.values() if (arc := arc_of(node.disk)) is not None]
        counts += [0 for node in cluster.running.values() if arc_of(node.disk) is None]
        mean = sum(counts) / len(counts)
        return max(abs(count - mean) for count in counts) / mean if mean else 1.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print."""
    options = _options(arguments)
    begin = time.perf_counter()

    def say(text: str) -> None:
        if not options.json:
            sys.stderr.write(f"{time.perf_counter() - begin:.0f} s: {text}\n")
            sys.stderr.flush()

    is_large = options.nodes > FEW
    parts = [part for part in PARTS if part in options.only and not (is_large and part == "balance")]
    measurement = Measurement(options.nodes, options.seed, parts, options.loss_s, say)
    with quiet_logs(), remembered_signatures(), quick_packets(), nothing_balanced() if is_large else nullcontext():
        try:
            run_simulated(options.seed, measurement.run, virtual_s_max=VIRTUAL_S_MAX, steps_max=10**10, wall_s_max=WALL_S_MAX)
        except SimulationStuck as problem:
            measurement.found.setdefault("violations", []).append(f"the simulation is stuck: {problem}")
    measurement.found["real_s"] = round(time.perf_counter() - begin, 1)
    sys.stdout.write(json.dumps(measurement.found, indent=2) + "\n")
    problems = measurement.problems()
    sys.stderr.writelines(f"{problem}\n" for problem in problems)
    return 1 if problems else 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = Parser(prog="python -m scenefold.simulation.scale", description="Measures a large cluster in virtual time.")
    parser.add_argument("--nodes", type=number(int, 3, 1_000), default=50, metavar="N")
    parser.add_argument("--only", type=_parts, default=PARTS, metavar="PART,...", help=f"of {', '.join(PARTS)}")
    parser.add_argument(
        "--loss-s", type=number(float, 1.0, 10 * HOUR_S), default=HOUR_S, metavar="SECONDS", help="how long packets are lost"
    )
    parser.add_argument("--json", action="store_true", help="no progress on standard error")
    parser.add_argument("--seed", type=number(int, 0, SEED_MAX), default=0, metavar="SEED")
    return parser.parse_args(arguments)


def _parts(text: str) -> tuple[str, ...]:
    parts = tuple(text.split(","))
    if set(parts) - set(PARTS):
        raise argparse.ArgumentTypeError(f"{text!r}: parts are {', '.join(PARTS)}")
    return parts


if __name__ == "__main__":
    raise SystemExit(main())
