"""If this failed, an older and a newer program would misread each other, or refuse each other without saying why."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgpack
import pytest
import trio

from conformance.world.logs import logged
from conformance.world.makers import Worlds
from scenefold.base.errors import PeerFault, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.wire import PROTOCOL_VERSION, Fault, FrameReader, ListScenes, Packet, RequestTable, decode_packet, frame
from scenefold.world import Connection, Priority, open_channel, serve_connection
from scenefold.world.serving import MALFORMED_MAX
from scenefold.world.versions import Versions

LOW = Priority.LOW
OLD, BOTH, NEW = Versions(1, 1), Versions(1, 2), Versions(2, 2)
UNKNOWN = 211


async def echo(packet: Packet, _peer: str) -> Packet:
    return packet


@asynccontextmanager
async def node(worlds: Worlds, versions: Versions) -> AsyncIterator[list[int]]:
    """A node that takes some versions; the list has those of its connections."""
    agreed: list[int] = []

    async def serve(connection: Connection) -> None:
        agreed.append(connection.version)
        await serve_connection(connection, echo)

    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0, versions).network.listen, worlds.address(0), LOW, serve)
        yield agreed
        nursery.cancel_scope.cancel()


async def raw_answers(connection: Connection, count: int, *packets: object) -> list[Packet]:
    """What comes back for packets that our own encoder does not make."""
    await connection.send(b"".join(frame(msgpack.packb(packet)) for packet in packets))
    reader, answers = FrameReader(), list[Packet]()
    with trio.fail_after(30):
        while len(answers) < count:
            data = await connection.receive(1 << 16)
            assert data, "the node closed the connection"
            answers += [decode_packet(payload) for payload in reader.feed(data)]
    return sorted(answers, key=lambda answer: answer.request_id)


@pytest.mark.parametrize(
    ("there", "here", "expected"), [(OLD, OLD, 1), (OLD, BOTH, 1), (BOTH, OLD, 1), (BOTH, BOTH, 2), (NEW, BOTH, 2), (BOTH, NEW, 2)]
)
async def test_both_talk_the_highest_version_that_both_take(worlds: Worlds, there: Versions, here: Versions, expected: int) -> None:
    async with node(worlds, there) as agreed:
        connection = await worlds.user("ada", here).network.connect(worlds.address(0), LOW)
        async with open_channel(connection) as channel:
            assert isinstance(await channel.request(ListScenes(), 30), ListScenes)
        assert connection.version == expected
        assert agreed == [expected]


@pytest.mark.expect_log("connection refused: user:ada takes version")
@pytest.mark.parametrize(("there", "here", "newer"), [(OLD, NEW, "here"), (NEW, OLD, "there")])
async def test_without_a_common_version_both_say_which_they_take(worlds: Worlds, there: Versions, here: Versions, newer: str) -> None:
    async with node(worlds, there) as agreed:
        said_there = f"takes {here} of the protocol, this program {there}: upgrade " + (
            "this program" if newer == "here" else "the program of user:ada"
        )
        async with logged(said_there):
            with pytest.raises(Unreachable) as caught:
                await worlds.user("ada", here).network.connect(worlds.address(0), LOW)
        assert f"takes {there} of the protocol, this program {here}" in caught.value.what
        assert caught.value.remedy.startswith("upgrade the program of node:" if newer == "here" else "upgrade this program")
        assert worlds.address(0) in caught.value.where
        assert agreed == []


@pytest.mark.expect_log("malformed packet")
async def test_a_field_too_many_is_refused_by_its_own_version_and_ignored_of_a_later_one(worlds: Worlds) -> None:
    longer = [ListScenes.TYPE, 5, None, 0, "of later"]
    async with node(worlds, BOTH):
        connection = await worlds.user("ada", OLD).network.connect(worlds.address(0), LOW)
        (fault,) = await raw_answers(connection, 1, longer)
        assert isinstance(fault, Fault) and fault.reason is RejectReason.ILL_FORMED and fault.request_id == 5
        assert f"5 fields, 4 were expected in version {PROTOCOL_VERSION}" in fault.text
        await connection.aclose()
        connection = await worlds.user("ada", NEW).network.connect(worlds.address(0), LOW)
        (answer,) = await raw_answers(connection, 1, longer)
        assert isinstance(answer, ListScenes) and answer.request_id == 5
        await connection.aclose()


@pytest.mark.expect_log("malformed packet: not supported")
async def test_packets_of_a_later_version_are_answered_by_faults_however_many(worlds: Worlds) -> None:
    count = 3 * MALFORMED_MAX
    async with node(worlds, BOTH):
        connection = await worlds.user("ada", NEW).network.connect(worlds.address(0), LOW)
        unknown = [[UNKNOWN, number, None, {"what": 1}] for number in range(1, count + 1)]
        *faults, answer = await raw_answers(connection, count + 1, *unknown, [RequestTable.TYPE, count + 1, None])
        for number, fault in enumerate(faults, 1):
            assert isinstance(fault, Fault) and fault.request_id == number
            assert f"not supported: {UNKNOWN} is no packet of version {PROTOCOL_VERSION}" in fault.text
        assert isinstance(answer, RequestTable)
        await connection.aclose()


@pytest.mark.expect_log("malformed packet")
async def test_the_asking_side_reads_answers_of_the_agreed_version(worlds: Worlds) -> None:
    """A newer node's answer has a field more: only who agreed on that version may overlook it."""

    async def serve(connection: Connection) -> None:
        await connection.receive(1 << 16)
        await connection.send(frame(msgpack.packb([ListScenes.TYPE, 1, None, 0, "of later"])))
        await connection.receive(1 << 16)

    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0, BOTH).network.listen, worlds.address(0), LOW, serve)
        connection = await worlds.user("ada", NEW).network.connect(worlds.address(0), LOW)
        async with open_channel(connection) as channel:
            assert isinstance(await channel.request(ListScenes(), 30), ListScenes)
        connection = await worlds.user("ada", OLD).network.connect(worlds.address(0), LOW)
        async with open_channel(connection) as channel:
            with pytest.raises(PeerFault, match="expected in version 1"):
                await channel.request(ListScenes(), 30)
        nursery.cancel_scope.cancel()
