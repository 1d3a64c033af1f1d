"""A little cluster under every fault there is, for the tests of determinism; `python -m unit.world.sim.scenario 7` prints its hash.

Nodes commit on each request and tell the others by datagram; they crash, by traps too, and come back.
"""

from __future__ import annotations

import sys
from pathlib import Path

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import node_id_of
from scenefold.wire import Packet, RequestPublicKey
from scenefold.world import Connection, DiskFailed, Environment, Links, Priority, World, open_links, serve_connection
from scenefold.world.sim import Delay, Point, SimNet, Weather, run_simulated
from scenefold.world.sim.entropy import dice

NODES = 4
END_S = 30.0
STORM = Weather(Delay(0.0005, 0.002, 1.0), loss=0.05, duplication=0.05, reordering=0.1, splitting=0.2, dead_after_s=5.0)
ADDRESSES = [f"10.0.0.{number + 1}" for number in range(NODES)]


class Node:
    """One machine, life after life."""

    def __init__(self, net: SimNet, address: str) -> None:
        self._net = net
        self._address = address
        self._life = trio.CancelScope()
        self.commits = 0

    def crash(self, *, silent: bool = False) -> None:
        self._net.crash(self._address, silent=silent)
        self._life.cancel()

    async def run(self) -> None:
        while True:
            world = self._net.world(f"node:{node_id_of(self._address)}", self._address)
            with trio.CancelScope() as self._life:
                try:
                    await self._live(world)
                except* DiskFailed:
                    self._net.note("died-in-commit", self._address)
            await trio.sleep(1.0)

    async def _live(self, world: World) -> None:
        environment = world.disk.open(Path("data"), ("rows",))

        async def handle(packet: Packet, _peer: str) -> Packet:
            assert isinstance(packet, RequestPublicKey)
            await world.workers.run("store", self._commit, environment, packet.key)
            return packet

        async def serve(connection: Connection) -> None:
            await serve_connection(connection, handle)

        async with open_links(world) as links, trio.open_nursery() as nursery:
            await nursery.start(world.network.listen, self._address, Priority.LOW, serve)
            nursery.start_soon(self._ask, world, links)
            nursery.start_soon(self._gossip, world)

    def _commit(self, environment: Environment, key: int) -> None:
        environment.update(lambda rows: rows.put("rows", key.to_bytes(4, "big"), b"x" * (key % 100)))
        self.commits += 1

    async def _ask(self, world: World, links: Links) -> None:
        while True:
            await world.clock.sleep(0.2 * world.entropy.uniform())
            other = ADDRESSES[int(world.entropy.uniform() * NODES)]
            request = RequestPublicKey(int.from_bytes(world.entropy.token(4), "big"))
            try:
                await links.request(other, Priority.LOW, request, 2.0)
            except ScenefoldError as error:
                self._net.note("failed", self._address, other, error.what)

    async def _gossip(self, world: World) -> None:
        datagrams = await world.network.open_datagrams(self._address, Priority.HIGH)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._listen, datagrams)
            while True:
                await world.clock.sleep(0.3)
                for address in ADDRESSES:
                    await datagrams.send(world.entropy.token(100), address)

    async def _listen(self, datagrams: object) -> None:
        while True:
            await datagrams.receive()  # type: ignore[attr-defined]


async def scenario(seed: int) -> SimNet:
    net = SimNet(seed, weather=STORM)
    nodes = [Node(net, address) for address in ADDRESSES]
    draw = dice(seed, "faults")
    async with trio.open_nursery() as nursery:
        for node in nodes:
            nursery.start_soon(node.run)
        while trio.current_time() < END_S:
            await trio.sleep(draw.random())
            victim = draw.randrange(NODES)
            here, there = ADDRESSES[victim], ADDRESSES[draw.randrange(NODES)]
            match draw.randrange(10):
                case 0:
                    nodes[victim].crash(silent=draw.random() < 0.5)
                case 1:
                    net.trap(here, draw.choice(list(Point)), draw.randrange(1, 20), nodes[victim].crash)
                case 2:
                    net.cut(here, there, one_way=draw.random() < 0.5)
                case 3:
                    net.partition(ADDRESSES[:2], ADDRESSES[2:])
                case 4:
                    net.clog(here, there)
                case 5:
                    net.slow(here, 20.0)
                case 6:
                    net.pause(here, 2 * draw.random())
                case 7:
                    net.reset(here, there)
                case 8:
                    net.machine(here).disk.slow(0.5)
                case _:
                    net.calm()
        nursery.cancel_scope.cancel()
    net.note("end", *(node.commits for node in nodes))
    return net


def run(seed: int) -> SimNet:
    return run_simulated(seed, scenario, seed, wall_s_max=60)


if __name__ == "__main__":
    print(run(int(sys.argv[1])).trace.hash)
