"""If this failed, a simulated crash would let the dead speak, or a crash at a chosen step would come a step too late."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from scenefold.base.errors import Unreachable
from scenefold.world import Connection, ConnectionLost, DiskFailed, Environment, World
from scenefold.world.sim import Point, SimNet
from unit.world.sim.little import ADA, HIGH, LOW, A, B, connected, node, received, simulated, sockets

TABLES = ("rows",)


def opened(world: World) -> Environment:
    return world.disk.open(Path("data"), TABLES)


def put(environment: Environment, key: bytes) -> None:
    environment.update(lambda rows: rows.put("rows", key, b"value"))


def keys(environment: Environment) -> list[bytes]:
    with environment.read() as rows:
        return list(rows.keys("rows", b"", b"\xff"))


def test_a_crash_is_heard_and_nobody_is_there_any_more() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, _there):
            net.crash(B)
            with pytest.raises(ConnectionLost, match="cut"):
                await here.receive(1)
            with pytest.raises(Unreachable, match="refused"):
                await net.world(ADA).network.connect(B, LOW)

    simulated(main)


def test_a_silent_crash_is_heard_only_after_the_machine_is_back() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, _there):
            net.crash(B, silent=True)
            await here.send(b"anybody?")
            with trio.move_on_after(30) as patience:
                await here.receive(1)
            assert patience.cancelled_caught
            with pytest.raises(Unreachable, match="no answer"):
                await net.world(ADA).network.connect(B, LOW)
            node(net, B)
            with pytest.raises(ConnectionLost, match="reset"):
                await here.receive(1)

    simulated(main)


def test_what_was_sent_before_the_crash_arrives() -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        await one.send(b"last words", B)
        net.crash(A)
        assert await received(other, 1) == [b"last words"]
        async with connected(net) as (here, there):
            await here.send(b"last words")
            net.crash(A)
            assert await there.receive(100) == b"last words"
            with pytest.raises(ConnectionLost, match="cut"):
                await there.receive(100)

    simulated(main)


def test_the_dead_say_and_write_nothing() -> None:
    async def main(net: SimNet) -> None:
        world = node(net, A)
        environment = opened(world)
        put(environment, b"before")
        socket = await world.network.open_datagrams(A, HIGH)
        ready = trio.Event()
        went_wrong: list[BaseException] = []

        async def live(connection: Connection) -> None:
            try:
                ready.set()
                await trio.sleep_forever()
            finally:
                with trio.CancelScope(shield=True):
                    await connection.send(b"goodbye")
                    await socket.send(b"goodbye", B)
                    try:
                        await world.workers.run("store", put, environment, b"after")
                    except DiskFailed as error:
                        went_wrong.append(error)
                    await connection.aclose()
                    await world.workers.run("store", environment.close)

        receiver = await node(net, B).network.open_datagrams(B, HIGH)
        async with connected(net) as (here, there):
            with trio.CancelScope() as life:
                async with trio.open_nursery() as nursery:
                    nursery.start_soon(live, here)
                    await ready.wait()
                    net.crash(A)
                    life.cancel()
            assert len(went_wrong) == 1
            assert await received(receiver, 1) == []
            with pytest.raises(ConnectionLost):
                await there.receive(10)
        assert keys(opened(node(net, A))) == [b"before"]

    simulated(main)


def test_the_end_of_the_dead_takes_no_time_even_in_the_middle_of_a_slow_sync() -> None:
    async def main(net: SimNet) -> None:
        world = node(net, A)
        environment = opened(world)
        net.machine(A).disk.slow(1000.0)
        with trio.CancelScope() as life:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(world.workers.run, "store", put, environment, b"lost or kept")
                await trio.sleep(10)
                net.crash(A)
                life.cancel()
        assert trio.current_time() == 10

    simulated(main)


def test_who_cannot_be_cancelled_is_let_go() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (_here, there):
            net.crash(B)
            with trio.CancelScope(shield=True), pytest.raises(ConnectionLost, match="crashed"):
                await there.receive(1)

    simulated(main)


@pytest.mark.parametrize("point", list(Point))
def test_a_trap_stops_a_machine_to_the_step(point: Point) -> None:
    async def main(net: SimNet) -> None:
        world = node(net, A)
        environment, socket = opened(world), await world.network.open_datagrams(A, HIGH)
        receiver = await node(net, B).network.open_datagrams(B, HIGH)
        life = trio.CancelScope()

        def crash() -> None:
            net.crash(A)
            life.cancel()

        net.trap(A, point, 3, crash)
        with life:
            for number in range(5):
                await world.workers.run("store", put, environment, b"%d" % number)
                await socket.send(b"%d" % number, B)
        found = keys(opened(node(net, A)))
        heard = sorted(await received(receiver, 1))
        assert len(found) == {Point.BEFORE_COMMIT: 2}.get(point, 3)
        assert len(heard) == (3 if point is Point.AFTER_SEND else 2)

    simulated(main)


def test_a_crash_within_a_sync_keeps_or_loses_it_as_the_seed_says() -> None:
    def survives(seed: int) -> bool:
        async def main(net: SimNet) -> bool:
            world = node(net, A)
            environment = opened(world)
            net.machine(A).disk.slow(1.0)
            with trio.CancelScope() as life:
                async with trio.open_nursery() as nursery:
                    nursery.start_soon(world.workers.run, "store", put, environment, b"key")
                    await trio.sleep(0.5)
                    net.crash(A)
                    life.cancel()
            return bool(keys(opened(node(net, A))))

        result: bool = simulated(main, seed=seed)
        return result

    assert {survives(seed) for seed in range(10)} == {False, True}


def test_a_new_life_draws_other_randomness_and_keeps_the_clock() -> None:
    async def main(net: SimNet) -> None:
        first = node(net, A)
        token, now = first.entropy.token(16), first.clock.now()
        net.crash(A)
        await trio.sleep(5)
        second = node(net, A)
        assert second.entropy.token(16) != token
        assert second.clock.now() == pytest.approx(now + 5)

    simulated(main)


def test_clocks_differ_and_drift() -> None:
    async def main(net: SimNet) -> None:
        one, other = node(net, A).clock, node(net, B).clock
        assert abs(one.now() - other.now()) > 1
        net.machine(A).clock.set_rate(1.01)
        begin, other_begin, began = one.now(), other.now(), trio.current_time()
        await one.sleep(101)
        assert one.now() - begin == pytest.approx(101)
        assert other.now() - other_begin == pytest.approx(100)
        assert trio.current_time() - began == pytest.approx(100)

    simulated(main)
