"""If this failed, nodes would talk to the wrong peer, to strangers, or lose bytes on the way."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
import trio

from conformance.world.logs import logged
from conformance.world.makers import Worlds
from scenefold.base.errors import LocalFault, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.world import Connection, ConnectionLost, Priority, World
from scenefold.world.ports import Serve

LOW, HIGH = Priority.LOW, Priority.HIGH


@asynccontextmanager
async def serving(world: World, address: str, serve: Serve, priority: Priority = LOW) -> AsyncIterator[None]:
    async with trio.open_nursery() as nursery:
        await nursery.start(world.network.listen, address, priority, serve)
        yield
        nursery.cancel_scope.cancel()


async def echo(connection: Connection) -> None:
    while data := await connection.receive(1 << 16):
        await connection.send(data)


async def receive_all(connection: Connection, count: int) -> bytes:
    received = b""
    while len(received) < count:
        data = await connection.receive(1 << 18)
        assert data, "the connection ended early"
        received += data
    return received


async def knock(world: World, address: str) -> None:
    """Connect and wait to be let in. With TLS 1.3 the one that connects learns only now that it was refused."""
    connection = await world.network.connect(address, LOW)
    try:
        await connection.receive(1)
    finally:
        await connection.aclose()


async def test_bytes_go_there_and_back_and_both_know_whom_they_talk_to(worlds: Worlds) -> None:
    peers = []

    async def serve(connection: Connection) -> None:
        peers.append(connection.peer)
        await echo(connection)

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        for world, name in ((worlds.node(1), f"node:{node_id_of(worlds.address(1))}"), (worlds.user("ada"), "user:ada")):
            connection = await world.network.connect(address, LOW)
            assert connection.peer == f"node:{node_id_of(address)}"
            await connection.send(b"hello")
            assert await receive_all(connection, 5) == b"hello"
            await connection.aclose()
            assert peers.pop() == name


async def test_much_data_both_ways_at_once(worlds: Worlds) -> None:
    payload = bytes(range(256)) * (1 << 14)
    address = worlds.address(0)
    async with serving(worlds.node(0), address, echo):
        connection = await worlds.user("ada").network.connect(address, LOW)
        async with trio.open_nursery() as nursery:
            nursery.start_soon(connection.send, memoryview(payload))
            assert await receive_all(connection, len(payload)) == payload
        await connection.aclose()


async def test_an_orderly_end_is_seen_as_one(worlds: Worlds) -> None:
    ended = trio.Event()

    async def serve(connection: Connection) -> None:
        assert await receive_all(connection, 3) == b"end"
        assert await connection.receive(10) == b""
        ended.set()

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        connection = await worlds.user("ada").network.connect(address, LOW)
        await connection.send(b"end")
        await connection.aclose()
        await ended.wait()
        with pytest.raises(ConnectionLost):
            await connection.send(b"more")


async def test_the_end_of_serving_ends_the_connection(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        await connection.send(b"bye")

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        connection = await worlds.user("ada").network.connect(address, LOW)
        assert await receive_all(connection, 3) == b"bye"
        assert await connection.receive(1) == b""
        await connection.aclose()


async def test_the_two_priorities_are_two_places(worlds: Worlds) -> None:
    address = worlds.address(0)
    async with serving(worlds.node(0), address, echo, HIGH):
        connection = await worlds.user("ada").network.connect(address, HIGH)
        await connection.aclose()
        with pytest.raises(Unreachable):
            await worlds.user("ada").network.connect(address, LOW)


async def test_nobody_there(worlds: Worlds) -> None:
    with pytest.raises(Unreachable) as caught:
        await worlds.user("ada").network.connect(worlds.address(5), LOW)
    assert worlds.address(5) in caught.value.where
    assert caught.value.remedy


async def test_a_port_in_use(worlds: Worlds) -> None:
    address = worlds.address(0)
    async with serving(worlds.node(0), address, echo):
        with pytest.raises(LocalFault, match="in use") as caught:
            await worlds.node(0).network.listen(address, LOW, echo)
        assert address in caught.value.where
        assert caught.value.remedy
    datagrams = await worlds.node(0).network.open_datagrams(address, HIGH)
    with pytest.raises(LocalFault, match="in use"):
        await worlds.node(0).network.open_datagrams(address, HIGH)
    await datagrams.aclose()


@pytest.mark.expect_log("connection refused: its certificate is not valid here")
async def test_a_member_of_another_cluster_stays_outside(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        assert connection.peer == "user:ada", "a stranger came in"
        await echo(connection)

    address, node = worlds.address(0), worlds.node(0)
    async with serving(node, address, serve):
        for _ in range(3):
            with pytest.raises((Unreachable, ConnectionLost)):
                await knock(worlds.stranger(), address)
        connection = await worlds.user("ada").network.connect(address, LOW)
        await connection.send(b"hello")
        assert await receive_all(connection, 5) == b"hello"
        assert node.network.turned_away == 3
        await connection.aclose()


@pytest.mark.expect_log("connection refused")
async def test_another_node_at_the_address(worlds: Worlds) -> None:
    async with serving(worlds.node(1), worlds.address(0), echo):
        async with logged("connection refused"):
            with pytest.raises(Unreachable):
                await worlds.user("ada").network.connect(worlds.address(0), LOW)


async def test_datagrams_find_nodes_and_answers_find_back(worlds: Worlds) -> None:
    nodes = [await worlds.node(number).network.open_datagrams(worlds.address(number), HIGH) for number in (0, 1)]
    client = await worlds.user("ada").network.open_datagrams(None, HIGH)
    with trio.fail_after(10):
        await nodes[0].send(b"to a node", worlds.address(1))
        assert await nodes[1].receive() == (b"to a node", nodes[0].here)
        assert nodes[0].here.address == worlds.address(0)
        await client.send(bytes(1400), worlds.address(0))
        data, source = await nodes[0].receive()
        assert len(data) == 1400
        await nodes[0].send(b"back", source)
        assert await client.receive() == (b"back", nodes[0].here)
    await client.send(b"to nobody", worlds.address(7))
    for datagrams in (*nodes, client):
        await datagrams.aclose()


async def test_a_sender_waits_for_a_reader_that_does_not_read(worlds: Worlds) -> None:
    go_on = trio.Event()
    pieces, sent = 32, 0

    async def serve(connection: Connection) -> None:
        await go_on.wait()
        count = 0
        while count < pieces << 20:
            count += len(await connection.receive(1 << 18))
        await connection.send(b"read it all")

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        connection = await worlds.user("ada").network.connect(address, LOW)

        async def send() -> None:
            nonlocal sent
            for _ in range(pieces):
                await connection.send(bytes(1 << 20))
                sent += 1

        async with trio.open_nursery() as nursery:
            nursery.start_soon(send)
            await worlds.silence(0.5)
            # What the transport itself takes up is some megabytes at most.
            assert sent < pieces // 2
            go_on.set()
            assert await receive_all(connection, 11) == b"read it all"
        await connection.aclose()


async def test_who_closes_without_reading_breaks_the_connection_for_the_other(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        await connection.receive(1)

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        connection = await worlds.user("ada").network.connect(address, LOW)

        async def send_on() -> None:
            while True:
                await connection.send(bytes(1 << 20))

        with trio.fail_after(30), pytest.raises(ConnectionLost):
            await send_on()
        await connection.aclose()


async def test_a_closed_connection_is_of_no_more_use_to_us(worlds: Worlds) -> None:
    address = worlds.address(0)
    async with serving(worlds.node(0), address, echo):
        connection = await worlds.user("ada").network.connect(address, LOW)
        await connection.aclose()
        await connection.aclose()
        with pytest.raises(ConnectionLost):
            await connection.send(b"x")
        with pytest.raises(ConnectionLost):
            await connection.receive(1)


async def test_a_receive_that_is_cancelled_loses_nothing(worlds: Worlds) -> None:
    go_on = trio.Event()

    async def serve(connection: Connection) -> None:
        await go_on.wait()
        await connection.send(b"late")
        await connection.receive(1)

    address = worlds.address(0)
    async with serving(worlds.node(0), address, serve):
        connection = await worlds.user("ada").network.connect(address, LOW)
        with trio.move_on_after(0.05) as patience:
            await connection.receive(10)
        assert patience.cancelled_caught
        go_on.set()
        assert await receive_all(connection, 4) == b"late"
        await connection.aclose()


async def test_many_clients_at_once(worlds: Worlds) -> None:
    address = worlds.address(0)
    echoed: list[bytes] = []

    async def client(number: int) -> None:
        connection = await worlds.user(f"u{number}").network.connect(address, LOW)
        await connection.send(b"%02d" % number)
        echoed.append(await receive_all(connection, 2))
        await connection.aclose()

    async with serving(worlds.node(0), address, echo):
        async with trio.open_nursery() as nursery:
            for number in range(20):
                nursery.start_soon(client, number)
    assert sorted(echoed) == [b"%02d" % number for number in range(20)]


async def test_datagrams_keep_their_boundaries(worlds: Worlds) -> None:
    node = await worlds.node(0).network.open_datagrams(worlds.address(0), HIGH)
    client = await worlds.user("ada").network.open_datagrams(None, HIGH)
    sizes = [1, 1400, 0, 700]
    with trio.fail_after(10):
        for size in sizes:
            await client.send(bytes(size), node.here)
        assert sorted([len((await node.receive())[0]) for _ in sizes]) == sorted(sizes)
    for datagrams in (node, client):
        await datagrams.aclose()


async def test_a_port_is_free_again_after_its_end(worlds: Worlds) -> None:
    address = worlds.address(0)
    for _ in range(2):
        async with serving(worlds.node(0), address, echo):
            connection = await worlds.user("ada").network.connect(address, LOW)
            await connection.aclose()
        datagrams = await worlds.node(0).network.open_datagrams(address, HIGH)
        await datagrams.aclose()
