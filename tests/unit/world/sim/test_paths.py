"""If this failed, a fault would not be what its name says, and what a simulation shows would be worth nothing."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.errors import Unreachable
from scenefold.world import ConnectionLost
from scenefold.world.sim import STILL, Delay, SimNet, Weather
from unit.world.sim.little import ADA, HIGH, LOW, A, B, connected, node, received, simulated, sockets

SENT = [number.to_bytes(4, "big") for number in range(1000)]


def datagrams_in(weather: Weather) -> list[bytes]:
    async def main(net: SimNet) -> list[bytes]:
        one, other = await sockets(net)
        for data in SENT:
            await one.send(data, B)
            await trio.sleep(0.01)
        return await received(other, 10)

    found: list[bytes] = simulated(main, weather)
    return found


def test_calm_weather_loses_nothing() -> None:
    assert datagrams_in(STILL) == SENT


def test_lost_datagrams_are_about_as_many_as_said() -> None:
    found = datagrams_in(Weather(loss=0.3))
    assert 600 < len(found) < 800
    assert len(set(found)) == len(found)


def test_doubled_datagrams_come_twice() -> None:
    found = datagrams_in(Weather(duplication=0.3))
    assert set(found) == set(SENT)
    assert 1200 < len(found) < 1400


def test_held_back_datagrams_are_overtaken() -> None:
    found = datagrams_in(Weather(Delay(0.001, 0.0, 0.001), reordering=0.3))
    assert sorted(found) == SENT != found


def test_delays_are_within_their_bounds() -> None:
    async def main(net: SimNet) -> list[float]:
        one, other = await sockets(net)
        times = []
        for data in SENT:
            sent_at = trio.current_time()
            await one.send(data, B)
            await other.receive()
            times.append(trio.current_time() - sent_at)
        return times

    times = sorted(simulated(main, Weather(Delay(0.01, 0.02, 0.5))))
    assert times[0] >= 0.01
    assert 0.025 < times[500] < 0.036
    assert 0.3 < times[-1] <= 0.5001


def test_a_socket_that_nobody_reads_overflows() -> None:
    async def main(net: SimNet) -> int:
        one, other = await sockets(net)
        for _ in range(300):
            await one.send(bytes(1400), B)
        await trio.sleep(1)
        return len(await received(other, 1))

    assert simulated(main) == 208 * 1024 // 1400


@pytest.mark.parametrize("one_way", [False, True])
def test_a_cut_path_carries_no_datagrams(one_way: bool) -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        net.cut(A, B, one_way=one_way)
        net.cut(A, B, one_way=one_way)
        await one.send(b"there", B)
        await other.send(b"back", A)
        assert await received(other, 1) == []
        assert await received(one, 1) == ([b"back"] if one_way else [])
        net.mend(A, B, one_way=one_way)
        await one.send(b"still cut once", B)
        net.mend(A, B, one_way=one_way)
        await one.send(b"again", B)
        assert await received(other, 1) == [b"again"]

    simulated(main)


def test_what_is_under_way_when_a_path_is_cut_is_lost() -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        await one.send(b"too late", B)
        net.cut(A, B)
        await trio.sleep(1)
        net.mend(A, B)
        assert await received(other, 1) == []

    simulated(main)


def test_a_partition_separates_its_groups_and_nobody_else() -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        client = await net.world(ADA).network.open_datagrams(None, HIGH)
        partition = net.partition({A}, {B})
        for socket in (one, other, client):
            for address in (A, B):
                await socket.send(socket.here.address.encode(), address)
        assert sorted(await received(one, 1)) == [A.encode(), client.here.address.encode()]
        assert sorted(await received(other, 1)) == [B.encode(), client.here.address.encode()]
        net.unite(partition)
        await one.send(b"again", B)
        assert await received(other, 1) == [b"again"]

    simulated(main)


def test_a_stream_waits_for_a_cut_path_and_goes_on_in_order() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, there):
            await here.send(b"1")
            assert await there.receive(10) == b"1"
            net.cut(A, B)
            for data in (b"2", b"3", b"4"):
                await here.send(data)
            with trio.move_on_after(30) as patience:
                await there.receive(10)
            assert patience.cancelled_caught
            net.mend(A, B)
            await trio.sleep(1)
            found = b""
            while len(found) < 3:
                found += await there.receive(10)
            assert found == b"234"

    simulated(main)


def test_who_sends_into_a_cut_path_is_told_in_the_end_and_the_other_only_when_it_speaks() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, there):
            net.cut(A, B)
            began = trio.current_time()
            await here.send(b"anybody?")
            with pytest.raises(ConnectionLost, match="timed out"):
                await here.receive(1)
            assert trio.current_time() - began == pytest.approx(60, abs=1)
            net.mend(A, B)
            with trio.move_on_after(100) as patience:
                await there.receive(1)
            assert patience.cancelled_caught
            await there.send(b"hello?")
            with pytest.raises(ConnectionLost, match="reset"):
                await there.receive(1)

    simulated(main)


def test_a_clogged_stream_crawls_and_recovers() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, there):
            net.clog(A, B, 10.0)
            began = trio.current_time()
            await here.send(bytes(100))
            await there.receive(1000)
            assert trio.current_time() - began > 0.5
            await here.send(bytes(100_000))
            net.unclog(A, B)
            began = trio.current_time()
            assert await there.receive(1000)
            assert trio.current_time() - began < 1

    simulated(main)


def test_what_was_sent_while_a_machine_was_slow_is_not_late_for_ever() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, there):
            net.slow(B, 1000.0)
            await here.send(bytes(100))
            with trio.move_on_after(5) as waited:
                await there.receive(1000)
            assert waited.cancelled_caught
            net.slow(B, 1.0)
            began = trio.current_time()
            assert await there.receive(1000)
            assert trio.current_time() - began < 1

    simulated(main, Weather(Delay(0.05, 0.0, 0.05)))


def test_what_was_begun_while_a_machine_was_slow_goes_on_faster_once_it_is_not() -> None:
    async def main(net: SimNet) -> tuple[float, float]:
        workers = node(net, A).workers
        began = trio.current_time()
        await workers.run("store", int)
        work_s = trio.current_time() - began
        net.slow(A, 1e6)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(workers.run, "store", int)
            await trio.sleep(10.0)
            assert nursery.child_tasks, "it takes minutes"
            net.slow(A, 1.0)
            began = trio.current_time()
        return work_s, trio.current_time() - began

    work_s, rest_s = simulated(main)
    assert rest_s < 1.0 and work_s < 1.0


def test_everything_of_a_slow_machine_takes_longer() -> None:
    async def main(net: SimNet) -> list[float]:
        world, other = node(net, A), node(net, B)
        receiver = await other.network.open_datagrams(B, HIGH)
        sender = await world.network.open_datagrams(A, HIGH)
        times = []
        for _ in range(2):
            began = trio.current_time()
            await sender.send(b"", B)
            await receiver.receive()
            times.append(trio.current_time() - began)
            began = trio.current_time()
            await world.workers.run("store", int)
            times.append(trio.current_time() - began)
            net.slow(A, 100.0)
        return times

    packet, work, slow_packet, slow_work = simulated(main, Weather(Delay(0.01, 0.0, 0.01)))
    assert slow_packet == pytest.approx(100 * packet, rel=0.01)
    assert slow_work > 10 * work


def test_a_paused_machine_takes_nothing_in_and_lets_nothing_out() -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        world = node(net, A)
        net.pause(A, 10)
        began = world.clock.now()
        await one.send(b"from the paused one", B)
        await other.send(b"to it", A)
        assert await received(other, 9.9) == []
        assert await received(one, 0.05) == []
        await world.workers.run("store", int)
        assert world.clock.now() - began >= 10
        assert await received(other, 1) == [b"from the paused one"]
        assert await received(one, 1) == [b"to it"]
        net.pause(A, 5)
        began = world.clock.now()
        await world.clock.sleep(1)
        assert world.clock.now() - began == pytest.approx(5)

    simulated(main)


def test_a_reset_is_heard_on_both_sides() -> None:
    async def main(net: SimNet) -> None:
        async with connected(net) as (here, there):
            assert net.reset(A, B) == 1
            for end in (here, there):
                with pytest.raises(ConnectionLost, match="reset"):
                    await end.receive(1)
                with pytest.raises(ConnectionLost, match="reset"):
                    await end.send(b"x")
            assert net.reset(A, B) == 0

    simulated(main)


def test_calm_ends_every_fault() -> None:
    async def main(net: SimNet) -> None:
        one, other = await sockets(net)
        net.cut(A, B)
        net.partition({A}, {B})
        net.clog(A, B)
        net.slow(A, 1000)
        net.pause(B, 1000)
        net.machine(A).disk.fill(0)
        net.calm()
        await one.send(b"through", B)
        assert await received(other, 0.1) == [b"through"]
        assert net.machine(A).disk.free_bytes > 0

    simulated(main)


def test_connecting_over_a_cut_path_takes_until_it_is_mended() -> None:
    async def main(net: SimNet) -> None:
        world = net.world(ADA)
        async with connected(net):
            net.cut(ADA, B)
            with pytest.raises(Unreachable, match="no answer within 10 s"):
                await world.network.connect(B, LOW)
            async with trio.open_nursery() as nursery:
                nursery.start_soon(world.network.connect, B, LOW)
                await trio.sleep(5)
                net.mend(ADA, B)

    simulated(main)
