"""A cluster of processes that people write to while it changes: what was acknowledged, and how to wait for what."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path

import trio

from loopback import addresses, free_ports
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location
from scenefold.client import Cluster, ClusterStatus, Movement, Space, connect, movements
from scenefold.node.local import LocalCluster, local_cluster

LOOK_S = 0.2
WRITE_PAUSE_S = 0.05
"""Nodes shall have time for other things than writes."""
PATIENCE_S = 90.0
SPACE = SpaceId(10)


class Kept:
    """Records that were acknowledged: whatever happens to the cluster, they must be readable."""

    def __init__(self, space: Space, seed: int = 1) -> None:
        self.space = space
        self.records: dict[Location, bytes] = {}
        self.lost_answers = 0
        self._dice = random.Random(seed)

    async def put(self, places: list[Location], payload_bytes: int) -> None:
        items = [(place, self._payload(place, payload_bytes)) for place in places]
        await self.space.put_many(items)
        self.records.update(items)

    async def put_evenly(self, count: int, payload_bytes: int, last_part: float = 1.0) -> None:
        """Over the whole line, or that part of it at its end."""
        length = int(LINE_LENGTH * last_part)
        begin = LINE_LENGTH - length
        places = (Location.from_number(begin + length * (2 * index + 1) // (2 * count)) for index in range(count))
        await self.put([place for place in places if place not in self.records], payload_bytes)

    async def go_on_writing(self, payload_bytes: int = 300) -> None:
        """A few more records, again and again, until cancelled. What got no answer may be there or not."""
        while True:
            at = self._dice.randrange(LINE_LENGTH - 64)
            try:
                await self.put([Location.from_number(at + index) for index in range(8)], payload_bytes)
            except (Unreachable, Refused):
                self.lost_answers += 1
            await trio.sleep(WRITE_PAUSE_S)

    async def check(self) -> None:
        places = sorted(self.records)
        found = await self.space.get_many(places)
        wrong = [place.hex()[:8] for place, payload in zip(places, found, strict=True) if payload != self.records[place]]
        assert not wrong, f"{len(wrong)} of {len(places)} acknowledged records are not readable: {wrong[:8]}"

    def _payload(self, place: Location, size: int) -> bytes:
        return bytes(place) + self._dice.randbytes(size - len(place))


class Living:
    """Processes, a client, and what that had acknowledged."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster, kept: Kept) -> None:
        self.nodes = nodes
        self.cluster = cluster
        self.kept = kept

    async def until(self, wanted: Callable[[ClusterStatus], bool], patience_s: float = PATIENCE_S) -> ClusterStatus:
        """The first look at the cluster in which it is as wanted."""
        found: ClusterStatus | None = None
        with trio.move_on_after(patience_s):
            while True:
                found = await self.cluster.look()
                if wanted(found):
                    return found
                await trio.sleep(LOOK_S)
        assert found is not None
        raise AssertionError(f"not so after {patience_s:g} s: {found.document()}")

    async def moving(self, wanted: Callable[[Movement], bool]) -> Movement:
        """The first handover that is as wanted."""
        found = await self.until(lambda status: any(map(wanted, movements(status.nodes))))
        return next(filter(wanted, movements(found.nodes)))

    async def at_rest(self, members: int, owners: int | None = None) -> ClusterStatus:
        """Once so many members are there, nothing is on its way or off, and so many (all) own something."""

        def is_at_rest(status: ClusterStatus) -> bool:
            return (
                len(status.nodes) == members
                and not status.degraded
                and not status.is_unsteady
                and not movements(status.nodes)
                and sum(node.arc is not None for node in status.nodes) == (members if owners is None else owners)
            )

        found = await self.until(is_at_rest)
        check_tiled(found)
        return found


def check_tiled(status: ClusterStatus) -> None:
    """By the nodes' own durable arcs every place has exactly one owner, in the order of the log."""
    arcs = [node.report.arc for node in status.nodes if node.report is not None and node.report.arc is not None]
    assert arcs[0].first == FIRST and arcs[-1].last == LAST
    assert all(left.last.next() == right.first for left, right in pairwise(arcs)), arcs


def half_arrived(movement: Movement) -> bool:
    """A part of the piece lies at the receiver, and another one does not."""
    return movement.step == "offered" and bool(movement.records) and 0 < (movement.records_arrived or 0) < (movement.records or 0)


@asynccontextmanager
async def living_cluster(
    folder: Path, count: int, *, spares: int = 0, options: tuple[str, ...] = (), module: str = "scenefold.node"
) -> AsyncIterator[Living]:
    ports = free_ports(addresses(count + spares))
    running = local_cluster(count, folder, spares=spares, ports=ports, options=options, module=module)
    async with running as nodes, connect(nodes.profile) as cluster:
        # What moves with bounds is counted here; copies have tests of their own.
        scene = await cluster.scenes.create("kept", copies=1)
        yield Living(nodes, cluster, Kept(scene.space(SPACE)))
