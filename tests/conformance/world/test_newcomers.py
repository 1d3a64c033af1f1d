"""If this failed, who has no certificate could join in one world, and not in the other."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import trio

from conformance.world.makers import Worlds
from scenefold.base.errors import Unreachable
from scenefold.world import Connection, Endpoint, Priority, World

WORDS = b"who has no certificate may ask for one"
LOST_S = 0.5


async def echo(connection: Connection) -> None:
    """Send back once what comes."""
    await connection.send(await connection.receive(1000))


async def never(_: Connection) -> None:
    raise AssertionError("a newcomer came in by the members' door")


async def answer_of(connection: Connection) -> bytes:
    data = b""
    with trio.fail_after(10):
        while more := await connection.receive(1000):
            data += more
    return data


async def test_a_newcomer_is_served_apart_from_members(worlds: Worlds, nursery: trio.Nursery) -> None:
    peers: list[str] = []

    async def newcomers(connection: Connection, _expected: Callable[[bytes], None]) -> None:
        peers.append(connection.peer)
        await echo(connection)

    node, address = worlds.node(0), worlds.address(0)

    async def listen(*, task_status: trio.TaskStatus[None]) -> None:
        await node.network.listen(address, Priority.HIGH, never, newcomers=newcomers, task_status=task_status)

    await nursery.start(listen)
    connection, _certificate = await worlds.newcomer().network.approach(address)
    await connection.send(WORDS)
    assert await answer_of(connection) == WORDS
    await connection.aclose()
    assert peers == [""]
    nursery.cancel_scope.cancel()


@pytest.mark.expect_log("connection refused")
async def test_where_no_newcomers_are_served_there_is_no_way_in(worlds: Worlds, nursery: trio.Nursery) -> None:
    node, address = worlds.node(0), worlds.address(0)
    await nursery.start(node.network.listen, address, Priority.HIGH, never)
    with pytest.raises(Unreachable), trio.fail_after(30):
        await worlds.newcomer().network.approach(address)
    nursery.cancel_scope.cancel()


async def test_where_nobody_listens_a_newcomer_hears_so(worlds: Worlds) -> None:
    worlds.node(0)
    with pytest.raises(Unreachable), trio.fail_after(30):
        await worlds.newcomer().network.approach(worlds.address(0))


async def test_a_broadcast_reaches_all_that_hear_and_they_can_answer(worlds: Worlds) -> None:
    heard: dict[int, bytes] = {}

    async def hear(number: int, node: World, *, task_status: trio.TaskStatus[None]) -> None:
        ears = await node.network.hear_broadcasts(worlds.address(number), Priority.HIGH)
        speaker = await node.network.open_datagrams(None, Priority.HIGH)
        task_status.started()
        data, source = await ears[0].receive()
        heard[number] = data
        await speaker.send(bytes([number]), source)
        for socket in (*ears, speaker):
            await socket.aclose()

    async with trio.open_nursery() as nursery:
        for number in range(3):
            await nursery.start(hear, number, worlds.node(number))
        asking, targets = await worlds.newcomer().network.open_broadcasts()
        for target in targets:
            await asking.send(WORDS, target)
        with trio.fail_after(10):
            answers = {(await asking.receive())[0] for _ in range(3)}
        await asking.aclose()
        # They close their sockets, and end.
    assert answers == {b"\x00", b"\x01", b"\x02"} and heard == dict.fromkeys(range(3), WORDS)


async def test_who_hears_broadcasts_hears_nothing_else_and_others_hear_none(worlds: Worlds) -> None:
    node = worlds.node(0)
    ears = await node.network.hear_broadcasts(worlds.address(0), Priority.HIGH)
    own = await node.network.open_datagrams(worlds.address(0), Priority.HIGH)
    asking, targets = await worlds.newcomer().network.open_broadcasts()
    got: list[tuple[str, bytes]] = []

    async def note(name: str, socket: object) -> None:
        while True:
            got.append((name, (await socket.receive())[0]))  # type: ignore[attr-defined]

    async with trio.open_nursery() as nursery:
        nursery.start_soon(note, "ears", ears[0])
        nursery.start_soon(note, "own", own)
        for target in targets:
            await asking.send(b"all", target)
        await asking.send(b"one", Endpoint(worlds.address(0), targets[0].port))
        await worlds.silence(LOST_S)
        nursery.cancel_scope.cancel()
    assert set(got) == {("ears", b"all"), ("own", b"one")}
    for socket in (*ears, own, asking):
        await socket.aclose()
