"""A small cluster at rest, for tests that then make something wrong behind its nodes' backs and ask a judge."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from dataclasses import dataclass

import trio

from scenefold.base.location import Location
from scenefold.client.scene import Scene
from scenefold.scene.layout import META, RENDERS
from scenefold.simulation.calm import unrest
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.disks import arc_of, place_of
from scenefold.simulation.history import Place
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.speed import remembered_signatures
from scenefold.store.layout import RECORDS
from scenefold.store.sealing import SEALED, sealed
from scenefold.world.sim import SimDisk, SimNet, run_simulated

FOUNDERS = 3
RECORDS_EACH = 2
START_S_MAX = 30.0


@dataclass(frozen=True, slots=True)
class Rest:
    """Three founders, a spare that does not run, and a client that has written two records to each founder, and one that it chose."""

    cluster: Cluster
    client: Client
    scene: Scene
    places: tuple[Location, ...]
    """In the order of the line: two of n0, two of n1, two of n2."""

    def place(self, number: int) -> Place:
        """What histories call it."""
        return Place(self.scene.id, META, self.places[number])

    def key(self, slot: int, number: int) -> bytes:
        """The key under which a record lies on a disk."""
        (key,) = (key for key in self.cluster.nodes[slot].disk.peek(RECORDS) if place_of(key) == self.place(number))
        return key


def overwrite(disk: SimDisk, table: str, key: bytes, value: bytes | None) -> None:
    """Change what a disk holds, without its node's knowledge; None deletes."""
    for folder in disk._folders.values():
        folder.writable(table).set(key, value if value is None or table not in SEALED else sealed(table, key, value))


def at_rest(look: Callable[[Rest], Awaitable[None]], seed: int = 1) -> None:
    """Look at such a cluster. Everything has ended afterwards."""
    with ExitStack() as stack:
        stack.enter_context(quiet_logs())
        stack.enter_context(remembered_signatures())
        run_simulated(seed, _play, look, seed, virtual_s_max=500.0, steps_max=1_000_000)


async def _play(look: Callable[[Rest], Awaitable[None]], seed: int) -> None:
    net = SimNet(seed)
    async with trio.open_nursery() as nursery:
        cluster = Cluster(net, FOUNDERS, 1, nursery)
        for slot in range(FOUNDERS):
            cluster.start(slot)
        with trio.fail_after(START_S_MAX):
            while unrest(cluster):  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
                await trio.sleep(0.5)
        opening = open_client("c", net.world("user:c"), cluster.facts, MemoryKeyring(), key_of(seed, "the writer"), cluster.watch.recorder)
        async with opening as client:
            client.scene = await client.scenes.open_or_create("quiet", copies=1)
            arcs = [arc for slot in range(FOUNDERS) if (arc := arc_of(cluster.nodes[slot].disk)) is not None]
            places = tuple(
                Location.from_number(arc.first.number + arc.length * (2 * number + 1) // (2 * RECORDS_EACH + 1))
                for arc in sorted(arcs, key=lambda arc: arc.first)
                for number in range(RECORDS_EACH)
            )
            for place in places:
                await client.scene.space(META).put(place, b"quiet")
            await client.scene.space(RENDERS).put_managed(b"anywhere")
            await look(Rest(cluster, client, client.scene, places))
        nursery.cancel_scope.cancel()
