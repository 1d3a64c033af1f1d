"""Two machines and a client, for tests of single faults."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import trio

from scenefold.base.ids import node_id_of
from scenefold.world import Connection, Datagrams, Priority, World
from scenefold.world.sim import SimNet, Weather, run_simulated
from scenefold.world.sim.weather import CALM

A, B, ADA = "10.0.0.1", "10.0.0.2", "user:ada"
LOW, HIGH = Priority.LOW, Priority.HIGH


def simulated(main: Callable[[SimNet], Awaitable[Any]], weather: Weather = CALM, seed: int = 1) -> Any:
    """Run `main(net)` in virtual time."""

    async def run() -> Any:
        return await main(SimNet(seed, weather=weather))

    return run_simulated(seed, run, virtual_s_max=10_000, wall_s_max=30)


def node(net: SimNet, address: str) -> World:
    return net.world(f"node:{node_id_of(address)}", address)


@asynccontextmanager
async def connected(net: SimNet) -> AsyncIterator[tuple[Connection, Connection]]:
    """A connection from the machine at A to the one at B: (A's end, B's end)."""
    ends: list[Connection] = []
    arrived = trio.Event()

    async def serve(connection: Connection) -> None:
        ends.append(connection)
        arrived.set()
        await trio.sleep_forever()

    one, other = node(net, A), node(net, B)
    async with trio.open_nursery() as nursery:
        await nursery.start(other.network.listen, B, LOW, serve)
        connection = await one.network.connect(B, LOW)
        await arrived.wait()
        yield connection, ends[0]
        nursery.cancel_scope.cancel()


async def received(datagrams: Datagrams, seconds: float) -> list[bytes]:
    """What arrives within a time."""
    found: list[bytes] = []
    with trio.move_on_after(seconds):
        while True:
            found.append((await datagrams.receive())[0])
    return found


async def sockets(net: SimNet) -> tuple[Datagrams, Datagrams]:
    """Sockets at A and B."""
    return await node(net, A).network.open_datagrams(A, HIGH), await node(net, B).network.open_datagrams(B, HIGH)
