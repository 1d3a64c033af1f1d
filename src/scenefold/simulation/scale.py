"""`python -m scenefold.simulation.scale --nodes 50|1000`: how a large cluster does, in virtual time (specs/17-simulation.md).

One JSON object on stdout: seconds until a joiner's table is complete, seconds until a dead node is removed, messages and bytes
a node and second; with at most `FEW` nodes also false removals in an hour of 2 % loss, and how even fill is after one end of the line was
loaded. All seconds are virtual but `real_s`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import trio

from scenefold.base.location import LINE_LENGTH, Location
from scenefold.scene.layout import META
from scenefold.simulation.calm import unrest
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, Habits, key_of, quiet_logs
from scenefold.simulation.disks import arc_of, records_of
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.speed import remembered_signatures
from scenefold.world.sim import CALM, SimNet, Trace, run_simulated

FEW = 100
LOSS = 0.02
HOUR_S = 3_600.0
MEASURE_S = 60.0
START_S_MAX = 600.0
REMOVAL_S_MAX = 900.0
LOADED_RECORDS = 1_500
LOADED_BYTES = 30_000
BALANCE_S_MAX = 3_600.0
VIRTUAL_S_MAX = 20_000.0
WALL_S_MAX = 7_200.0
"""The default of remove_after_s stands: this measures what people run."""


@dataclass(slots=True)
class Traffic:
    """Counts packets and bytes as the trace tells of them, while it is told to."""

    messages: int = 0
    bytes: int = 0

    def line(self, line: str) -> None:
        """One line of the trace: <time> udp-send <address> <port> <address> <port> <bytes> …, or tcp-send <pipe> <from> <to> <bytes> …"""
        words = line.split()
        if words[1] == "udp-send":
            self.messages += 1
            self.bytes += int(words[6])
        elif words[1] == "tcp-send" and words[5].isdigit():
            self.messages += 1
            self.bytes += int(words[5])


class Measurement:
    """A large cluster and what is measured on it, one thing after another."""

    def __init__(self, nodes: int, seed: int, say: Callable[[str], None]) -> None:
        self.found: dict[str, Any] = {"nodes": nodes}
        self._nodes = nodes
        self._net = SimNet(seed, trace=Trace(keep=0))
        self._say = say

    async def run(self) -> None:
        """Measure everything."""
        async with trio.open_nursery() as nursery:
            cluster = Cluster(self._net, self._nodes, 1, nursery, Habits(remove_after_s=None))
            nursery.start_soon(watch_removals, cluster)
            for slot in range(self._nodes):
                cluster.start(slot)
            self.found["start_s"] = await self._wait(lambda: self._is_calm(cluster), START_S_MAX)
            self._say(f"{self._nodes} nodes stand after {self.found['start_s']} s")
            await self._traffic()
            await self._join(cluster)
            await self._removal(cluster)
            if self._nodes <= FEW:
                await self._balance(cluster)
                await self._loss(cluster)
            self.found["violations"] = [violation.what for violation in cluster.watch.violations]
            nursery.cancel_scope.cancel()

    def _is_calm(self, cluster: Cluster) -> bool:
        return not unrest(cluster)

    async def _wait(self, holds: Callable[[], bool], seconds: float) -> float | None:
        """Virtual seconds until something holds; None if it does not in time."""
        begin = self._net.now
        while not holds():
            if self._net.now - begin > seconds:
                return None
            await trio.sleep(0.25)
        return round(self._net.now - begin, 2)

    async def _traffic(self) -> None:
        """What a node sends when nothing happens."""
        traffic = Traffic()
        self._net.trace.on_line = traffic.line
        await trio.sleep(MEASURE_S)
        self._net.trace.on_line = None
        self.found["messages_per_node_s"] = round(traffic.messages / self._nodes / MEASURE_S, 2)
        self.found["bytes_per_node_s"] = round(traffic.bytes / self._nodes / MEASURE_S, 1)
        self._say(f"{self.found['messages_per_node_s']} messages and {self.found['bytes_per_node_s']} bytes a node and second")

    async def _join(self, cluster: Cluster) -> None:
        """A spare is started: when does it know a status of every member?"""
        joiner = cluster.nodes[self._nodes]
        cluster.start(joiner.slot)

        def knows_all() -> bool:
            if joiner.context is None or not joiner.context.cluster_log.registry.position:
                return False
            registry, roster = joiner.context.cluster_log.registry, joiner.context.roster
            return len(list(roster.statuses())) >= len(registry.members) - 1

        self.found["table_complete_s"] = await self._wait(knows_all, START_S_MAX)
        self._say(f"a joiner's table is complete after {self.found['table_complete_s']} s")

    async def _removal(self, cluster: Cluster) -> None:
        """A node dies without a word: when does the log remove it?"""
        victim = cluster.nodes[self._nodes // 2]
        before = cluster.watch.counts["removals"]
        cluster.crash(victim.slot, silent=True)
        self.found["removal_s"] = await self._wait(lambda: cluster.watch.counts["removals"] > before, REMOVAL_S_MAX)
        self._say(f"a dead node is removed after {self.found['removal_s']} s")

    async def _loss(self, cluster: Cluster) -> None:
        """An hour in which two of a hundred packets are lost."""
        before = cluster.watch.counts["removals"]
        self._net.set_weather(replace(CALM, loss=LOSS))
        await trio.sleep(HOUR_S)
        self._net.set_weather(CALM)
        self.found["false_removals"] = cluster.watch.counts["removals"] - before
        self._say(f"{self.found['false_removals']} removals in an hour of {LOSS:.0%} loss")

    async def _balance(self, cluster: Cluster) -> None:
        """Everything is written into the first hundredth of the line: when does every node hold the same within 5 %?"""
        keyring, writer = MemoryKeyring(), key_of(self._net.seed, "the writer")
        founders = [(node.node_id, node.address) for slot, node in cluster.nodes.items() if slot < self._nodes]
        world = self._net.world("user:loader")
        async with open_client("loader", world, founders, keyring, writer, cluster.watch.recorder) as client:
            client.scene = await client.scenes.open_or_create("loaded")
            await self._load(client)
        begin = self._net.now
        seconds = await self._wait(lambda: self._spread(cluster) <= 0.05, BALANCE_S_MAX)
        self.found["balance_s"] = seconds
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

    def _spread(self, cluster: Cluster) -> float:
        """The largest distance of a member's fill from their mean, of the mean."""
        counts = [len(records_of(node.disk, arc)) for node in cluster.running.values() if (arc := arc_of(node.disk)) is not None]
        counts += [0 for node in cluster.running.values() if arc_of(node.disk) is None]
        mean = sum(counts) / len(counts)
        return max(abs(count - mean) for count in counts) / mean if mean else 1.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(prog="python -m scenefold.simulation.scale", description="Measures a large cluster in virtual time.")
    parser.add_argument("--nodes", type=int, default=50, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="SEED")
    options = parser.parse_args(arguments)
    if not 3 <= options.nodes <= 1_000:
        parser.error("from 3 to 1000 nodes")
    quiet_logs()
    begin = time.perf_counter()
    measurement = Measurement(options.nodes, options.seed, lambda text: print(text, file=sys.stderr, flush=True))  # noqa: T201
    with remembered_signatures():
        run_simulated(options.seed, measurement.run, virtual_s_max=VIRTUAL_S_MAX, steps_max=10**10, wall_s_max=WALL_S_MAX)
    measurement.found["real_s"] = round(time.perf_counter() - begin, 1)
    sys.stdout.write(json.dumps(measurement.found, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
