"""If this failed, requests on one connection would block, mix up or outlive each other."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
import trio

from conformance.world.logs import logged
from conformance.world.makers import Worlds
from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import ANSWER_BYTES_MAX, FRAME_BYTES_MAX, REQUESTS_HANDLED_MAX, REQUESTS_IN_FLIGHT_MAX
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.wire import (
    Fault,
    FrameReader,
    GetMany,
    GetManyReply,
    ListScenes,
    Packet,
    RecordKey,
    RequestPublicKey,
    SendRays,
    decode_packet,
    encode_frame,
    frame,
)
from scenefold.world import Channel, Connection, Links, Priority, open_channel, open_links, serve_connection

LOW = Priority.LOW
LONG_S = 60.0

Handle = Callable[[Packet, str], Awaitable[Packet | None]]


def ask(number: int) -> RequestPublicKey:
    return RequestPublicKey(request_id=0, mini_status=None, key=number)


def rays(size: int, count: int = 0) -> SendRays:
    return SendRays(
        request_id=0,
        mini_status=None,
        job=1,
        frame=0,
        attempt=0,
        link_sequence=1 + count,
        all_until=0,
        selective=b"",
        render_location=(),
        counts=(),
        closed=(),
        batches=(),
        rays=bytes(size),
    )


async def echo(packet: Packet, _peer: str) -> Packet:
    return packet


async def never(_packet: Packet, _peer: str) -> Packet:
    await trio.sleep_forever()


@asynccontextmanager
async def node(worlds: Worlds, handle: Handle, number: int = 0) -> AsyncIterator[trio.CancelScope]:
    """A node that handles packets; the scope stops it."""

    async def serve(connection: Connection) -> None:
        await serve_connection(connection, handle)

    stop = trio.CancelScope()

    async def listen(task_status: trio.TaskStatus[None]) -> None:
        with stop:
            await worlds.node(number).network.listen(worlds.address(number), LOW, serve, task_status=task_status)

    async with trio.open_nursery() as nursery:
        await nursery.start(listen)
        yield stop
        stop.cancel()


@asynccontextmanager
async def channel_to(worlds: Worlds, handle: Handle) -> AsyncIterator[Channel]:
    async with node(worlds, handle):
        async with open_channel(await connect(worlds), "the node") as channel:
            yield channel


async def connect(worlds: Worlds) -> Connection:
    return await worlds.user("ada").network.connect(worlds.address(0), LOW)


@asynccontextmanager
async def raw_connection(worlds: Worlds) -> AsyncIterator[Connection]:
    connection = await connect(worlds)
    try:
        yield connection
    finally:
        await connection.aclose()


async def next_packets(connection: Connection, reader: FrameReader) -> list[Packet]:
    while True:
        data = await connection.receive(1 << 16)
        assert data, "the connection ended"
        if frames := reader.feed(data):
            return [decode_packet(packet) for packet in frames]


async def test_answers_come_in_any_order(worlds: Worlds) -> None:
    turns = [trio.Event() for _ in range(41)]
    turns[40].set()

    async def in_reverse(packet: Packet, peer: str) -> Packet:
        assert peer == "user:ada"
        assert isinstance(packet, RequestPublicKey)
        await turns[packet.key + 1].wait()
        turns[packet.key].set()
        return packet

    answers: list[int] = []

    async def request(channel: Channel, number: int) -> None:
        answer = await channel.request(ask(number), LONG_S)
        assert isinstance(answer, RequestPublicKey)
        assert answer.key == number
        answers.append(number)

    async with channel_to(worlds, in_reverse) as channel:
        async with trio.open_nursery() as nursery:
            for number in range(40):
                nursery.start_soon(request, channel, number)
    assert sorted(answers) == list(range(40))


async def test_a_timeout_harms_no_other_request(worlds: Worlds) -> None:
    release = trio.Event()

    async def slow_for_one(packet: Packet, _peer: str) -> Packet:
        if isinstance(packet, RequestPublicKey) and packet.key == 1:
            await release.wait()
        return packet

    async with channel_to(worlds, slow_for_one) as channel:
        with pytest.raises(Unreachable, match=r"no answer within 0\.05 s") as caught:
            await channel.request(ask(1), 0.05)
        assert caught.value.where == "the node"
        release.set()
        # The late answer to the first request arrives before this one and must be dropped.
        answer = await channel.request(ask(2), LONG_S)
        assert isinstance(answer, RequestPublicKey)
        assert answer.key == 2


async def test_a_cancelled_request_frees_its_slot(worlds: Worlds) -> None:
    async def silent(packet: Packet, _peer: str) -> Packet | None:
        return packet if isinstance(packet, ListScenes) else None

    async with channel_to(worlds, silent) as channel:
        for _ in range(2):
            async with trio.open_nursery() as nursery:
                for number in range(REQUESTS_IN_FLIGHT_MAX):
                    nursery.start_soon(channel.request, ask(number), LONG_S)
                await worlds.silence(0.01)
                nursery.cancel_scope.cancel()
        await channel.request(ListScenes(request_id=0, mini_status=None), LONG_S)


async def test_who_asks_for_much_and_reads_nothing_binds_few_large_answers(worlds: Worlds) -> None:
    asked = 0

    async def list_scenes(packet: Packet, _peer: str) -> Packet:
        nonlocal asked
        if not isinstance(packet, ListScenes):
            return packet
        asked += 1
        return rays(7 << 20)

    async with node(worlds, list_scenes):
        greedy = await connect(worlds)
        for number in range(1, REQUESTS_HANDLED_MAX):
            await greedy.send(encode_frame(ListScenes(request_id=number)))
        # What the transport itself takes up lets a few more through.
        await worlds.silence(0.3)
        assert 0 < asked <= ANSWER_BYTES_MAX // FRAME_BYTES_MAX + 4
        await greedy.send(encode_frame(replace(ask(1), request_id=99)))
        reader, answered = FrameReader(), 0
        while answered < REQUESTS_HANDLED_MAX:
            answered += len(reader.feed(await greedy.receive(1 << 20)))
        assert asked == REQUESTS_HANDLED_MAX - 1
        await greedy.aclose()


async def test_small_questions_that_take_long_hold_up_no_others(worlds: Worlds) -> None:
    """As of places that their node is still learning about, beside those of which it knows."""
    waiting, all_wait, go_on = 0, trio.Event(), trio.Event()

    async def look_up(packet: Packet, _peer: str) -> Packet:
        nonlocal waiting
        assert isinstance(packet, GetMany)
        if packet.position:
            waiting += 1
            if waiting == REQUESTS_HANDLED_MAX // 2:
                all_wait.set()
            await go_on.wait()
        return GetManyReply(records=(None,))

    def question(position: int) -> GetMany:
        return GetMany(SceneId(1), position, (RecordKey(SpaceId(1), FIRST, b""),))

    async with node(worlds, look_up):
        async with open_channel(await connect(worlds)) as channel, trio.open_nursery() as nursery:
            for _ in range(REQUESTS_HANDLED_MAX // 2):
                nursery.start_soon(channel.request, question(1), LONG_S)
            with trio.fail_after(LONG_S / 2):
                await all_wait.wait()
                await channel.request(question(0), LONG_S / 2)
            go_on.set()


async def test_a_lost_connection_fails_all_that_wait(worlds: Worlds) -> None:
    failures: list[str] = []

    async def request(channel: Channel) -> None:
        with pytest.raises(Unreachable) as caught:
            await channel.request(ask(1), LONG_S)
        failures.append(caught.value.what)

    arrived = trio.Event()

    async def stuck(packet: Packet, peer: str) -> Packet:
        arrived.set()
        return await never(packet, peer)

    async with node(worlds, stuck) as stop:
        async with open_channel(await connect(worlds)) as channel:
            async with trio.open_nursery() as nursery:
                for _ in range(5):
                    nursery.start_soon(request, channel)
                await arrived.wait()
                stop.cancel()
            assert not channel.is_open
            with pytest.raises(Unreachable):
                await channel.request(ask(1), LONG_S)
    assert len(failures) == 5


async def test_frames_of_the_greatest_size(worlds: Worlds) -> None:
    packet = rays(7 << 20)
    async with channel_to(worlds, echo) as channel:
        async with trio.open_nursery() as nursery:
            for _ in range(3):
                nursery.start_soon(channel.request, ask(1), LONG_S)
                nursery.start_soon(channel.request, packet, LONG_S)
        with pytest.raises(LocalFault):
            await channel.request(rays(9 << 20), LONG_S)
        await channel.request(ask(1), LONG_S)


async def test_packets_without_an_answer_arrive_before_an_orderly_end(worlds: Worlds) -> None:
    received: list[int] = []
    all_here = trio.Event()

    async def take(packet: Packet, _peer: str) -> None:
        assert isinstance(packet, SendRays)
        received.append(packet.link_sequence - 1)
        if len(received) == 100:
            all_here.set()

    async with node(worlds, take):
        async with open_channel(await connect(worlds)) as channel:
            for number in range(100):
                await channel.send(rays(10_000, number))
        await all_here.wait()
    # Each is handled in a task of its own, so nothing promises the order.
    assert sorted(received) == list(range(100))


async def test_no_more_is_handled_at_a_time_than_allowed(worlds: Worlds) -> None:
    release = trio.Event()
    running = most = 0

    async def count(packet: Packet, _peer: str) -> Packet:
        nonlocal running, most
        running += 1
        most = max(most, running)
        if running == REQUESTS_HANDLED_MAX:
            release.set()
        await release.wait()
        running -= 1
        return packet

    async with channel_to(worlds, count) as channel:
        async with trio.open_nursery() as nursery:
            for number in range(2 * REQUESTS_HANDLED_MAX):
                nursery.start_soon(channel.request, ask(number), LONG_S)
    assert most == REQUESTS_HANDLED_MAX


@pytest.mark.expect_log("damaged thing")
@pytest.mark.expect_log("nonsense")
async def test_what_a_handler_raises_becomes_a_reason(worlds: Worlds) -> None:
    errors = [
        (Refused(RejectReason.BUSY, "busy now"), RejectReason.BUSY),
        (PeerFault("nonsense"), RejectReason.ILL_FORMED),
        (DamagedData("a damaged thing"), RejectReason.SIGNATURE_INVALID),
    ]

    async def complain(packet: Packet, _peer: str) -> Packet:
        assert isinstance(packet, RequestPublicKey)
        raise errors[packet.key][0]

    async with channel_to(worlds, complain) as channel:
        for number, (error, reason) in enumerate(errors):
            with pytest.raises(Refused) as caught:
                await channel.request(ask(number), LONG_S)
            assert caught.value.reason is reason
            assert str(error) in caught.value.what


@pytest.mark.expect_log("no packet")
async def test_a_malformed_packet_is_answered_and_the_connection_lives(worlds: Worlds) -> None:
    async with node(worlds, echo), raw_connection(worlds) as connection:
        reader = FrameReader()
        await connection.send(frame(bytes([0x93, 0xCC, 0xF0, 77, 0xC0])))
        [fault] = await next_packets(connection, reader)
        assert isinstance(fault, Fault)
        assert (fault.request_id, fault.reason) == (77, RejectReason.ILL_FORMED)
        await connection.send(encode_frame(RequestPublicKey(request_id=5, mini_status=None, key=1)))
        [answer] = await next_packets(connection, reader)
        assert answer.request_id == 5


@pytest.mark.expect_log("closed after 9 malformed packets")
@pytest.mark.expect_log("malformed packet")
async def test_patience_with_malformed_packets_ends(worlds: Worlds) -> None:
    async with node(worlds, echo), raw_connection(worlds) as connection:
        async with logged("closed after 9 malformed packets"):
            for _ in range(9):
                await connection.send(frame(b"\xc1"))
            # Patience is judged when more arrives.
            await worlds.silence(0.05)
            await connection.send(frame(b"\xc1"))
        assert await connection.receive(1) == b""


@pytest.mark.expect_log("frame.length")
async def test_a_frame_over_the_limit_ends_only_its_connection(worlds: Worlds) -> None:
    async with channel_to(worlds, echo) as channel, raw_connection(worlds) as connection:
        await connection.send(b"\xff\xff\xff\xff and more")
        [fault] = await next_packets(connection, FrameReader())
        assert isinstance(fault, Fault)
        assert (fault.request_id, fault.reason) == (0, RejectReason.LIMIT_EXCEEDED)
        await channel.request(ask(1), LONG_S)


@pytest.mark.expect_log("user:ada: the connection ended within a frame")
async def test_a_truncated_frame_ends_only_its_connection(worlds: Worlds) -> None:
    async with channel_to(worlds, echo) as channel:
        async with logged("within a frame"), raw_connection(worlds) as connection:
            await connection.send(frame(bytes(1000))[:500])
        await channel.request(ask(1), LONG_S)


@pytest.mark.expect_log("malformed packet")
async def test_a_malformed_answer_fails_its_request(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        reader = FrameReader()
        [request] = await next_packets(connection, reader)
        await connection.send(frame(bytes([0x94, 37, request.request_id, 0xC0, 0xC3])))
        await connection.receive(1)

    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0).network.listen, worlds.address(0), LOW, serve)
        async with open_channel(await connect(worlds)) as channel:
            with pytest.raises(PeerFault):
                await channel.request(ask(1), LONG_S)
        nursery.cancel_scope.cancel()


async def test_links_share_one_channel_and_find_a_node_again(worlds: Worlds) -> None:
    peers: set[Connection] = set()
    address = worlds.address(0)

    async def serve(connection: Connection) -> None:
        peers.add(connection)
        await serve_connection(connection, echo)

    async def request(links: Links) -> None:
        await links.request(address, LOW, ask(1), LONG_S)

    world = worlds.node(0)
    async with open_links(worlds.user("ada")) as links:
        for life in range(2):
            async with trio.open_nursery() as nursery:
                await nursery.start(world.network.listen, address, LOW, serve)
                async with trio.open_nursery() as requests:
                    for _ in range(20):
                        requests.start_soon(request, links)
                await links.send(address, LOW, rays(10), LONG_S)
                nursery.cancel_scope.cancel()
            # Until the end of the node's life is heard, requests would go into the dead channel.
            await worlds.silence(0.1)
            assert len(peers) == life + 1


async def test_links_to_nobody(worlds: Worlds) -> None:
    failures: list[Unreachable] = []

    async def request(links: Links) -> None:
        with pytest.raises(Unreachable) as caught:
            await links.request(worlds.address(3), LOW, ask(1), LONG_S)
        failures.append(caught.value)

    async with open_links(worlds.user("ada")) as links:
        async with trio.open_nursery() as nursery:
            for _ in range(5):
                nursery.start_soon(request, links)
    assert len(failures) == 5
    assert len({id(failure) for failure in failures}) == 5
    assert all(worlds.address(3) in failure.where for failure in failures)


async def test_a_caller_that_gives_up_does_not_take_the_attempt_along(worlds: Worlds) -> None:
    async with node(worlds, echo), open_links(worlds.user("ada")) as links:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(links.request, worlds.address(0), LOW, ask(1), LONG_S)
            await trio.lowlevel.checkpoint()
            nursery.cancel_scope.cancel()
        answer = await links.request(worlds.address(0), LOW, ask(2), LONG_S)
        assert isinstance(answer, RequestPublicKey)


async def test_errors_of_the_body_come_out_as_they_are(worlds: Worlds) -> None:
    async def use() -> None:
        async with open_links(worlds.user("ada")) as links:
            with pytest.raises(Unreachable):
                await links.request(worlds.address(3), LOW, ask(1), LONG_S)
            raise LocalFault("mine")

    with pytest.raises(LocalFault, match="mine"):
        await use()
