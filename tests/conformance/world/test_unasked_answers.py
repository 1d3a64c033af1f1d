"""If this failed, somebody whom a program has once asked something could keep it busy with answers to nothing; or an honest
node that is slow would be cut off."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest
import trio

from conformance.world.logs import logged
from conformance.world.makers import Worlds
from conformance.world.test_channels import LONG_S, LOW, ask, connect, next_packets, node
from scenefold.base.errors import PeerFault, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.wire import Fault, FrameReader, ListScenes, Packet, RequestPublicKey, encode_frame, frame
from scenefold.world import Channel, Connection, ConnectionLost, open_channel, open_links

UNASKED = "nobody asked for"


@asynccontextmanager
async def channel_to(worlds: Worlds, serve: Callable[[Connection], Awaitable[None]]) -> AsyncIterator[Channel]:
    """A channel to a node that answers as it likes."""
    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0).network.listen, worlds.address(0), LOW, serve)
        async with open_channel(await connect(worlds), "the node") as channel:
            yield channel
        nursery.cancel_scope.cancel()


async def fails(channel: Channel, why: str) -> None:
    with pytest.raises(Unreachable, match=why):
        await channel.request(ask(1), LONG_S)


@pytest.mark.expect_log(f"the node: .*{UNASKED}")
@pytest.mark.parametrize("answer", [77, 0, None], ids=["another id", "no id", "not even a packet"])
async def test_an_answer_to_nothing_ends_the_channel_and_all_that_wait_hear_why(answer: int | None, worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        reader, waiting = FrameReader(), 0
        while waiting < 3:
            waiting += len(await next_packets(connection, reader))
        await connection.send(frame(b"\xc1") if answer is None else encode_frame(replace(ask(1), request_id=answer)))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        async with trio.open_nursery() as nursery:
            for _ in range(3):
                nursery.start_soon(fails, channel, UNASKED)
        await channel.closed.wait()
        await fails(channel, UNASKED)


@pytest.mark.expect_log(f"the node: .*{UNASKED}")
async def test_who_sends_without_being_asked_anything_is_read_no_more(worlds: Worlds) -> None:
    ended = trio.Event()

    async def serve(connection: Connection) -> None:
        try:
            while True:
                await connection.send(encode_frame(replace(ask(1), request_id=1)))
        except ConnectionLost:
            ended.set()

    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0).network.listen, worlds.address(0), LOW, serve)
        async with logged(UNASKED), open_channel(await connect(worlds), "the node") as channel:
            await channel.closed.wait()
        await ended.wait()
        nursery.cancel_scope.cancel()


@pytest.mark.expect_log(f"the node: .*{UNASKED}")
async def test_a_second_answer_to_one_request_is_one_to_nothing(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        [request] = await next_packets(connection, FrameReader())
        await connection.send(2 * encode_frame(request))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        assert isinstance(await channel.request(ask(1), LONG_S), RequestPublicKey)
        await channel.closed.wait()


@pytest.mark.expect_log("the node: .*the peer ended the connection: enough")
async def test_a_peer_that_ends_the_connection_says_why(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        await next_packets(connection, FrameReader())
        await connection.send(encode_frame(Fault(RejectReason.LIMIT_EXCEEDED, "enough\x1b")))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        await fails(channel, r"ended the connection: enough\\x1b")


@pytest.mark.expect_log("the node: .*frame.length")
async def test_a_frame_over_the_limit_ends_the_channel(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        await next_packets(connection, FrameReader())
        await connection.send(b"\xff\xff\xff\xff")
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        await fails(channel, "allowed")


async def test_late_answers_of_a_slow_node_end_nothing(worlds: Worlds) -> None:
    release = trio.Event()

    async def slow(packet: Packet, _peer: str) -> Packet:
        if isinstance(packet, RequestPublicKey):
            await release.wait()
        return packet

    async with node(worlds, slow), open_channel(await connect(worlds)) as channel:
        for _ in range(2):
            async with trio.open_nursery() as nursery:
                for number in range(20):
                    nursery.start_soon(channel.request, ask(number), LONG_S)
                await worlds.silence(0.05)
                nursery.cancel_scope.cancel()
            with pytest.raises(Unreachable, match="no answer within"):
                await channel.request(ask(99), 0.05)
        release.set()
        for number in range(60):
            answer = await channel.request(ask(number), LONG_S)
            assert isinstance(answer, RequestPublicKey) and answer.key == number
        await worlds.silence(0.05)
        assert channel.is_open


@pytest.mark.expect_log(f"the node: .*{UNASKED}")
async def test_a_late_answer_counts_once(worlds: Worlds) -> None:
    given_up = trio.Event()

    async def serve(connection: Connection) -> None:
        [request] = await next_packets(connection, FrameReader())
        await given_up.wait()
        await connection.send(2 * encode_frame(request))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        with pytest.raises(Unreachable, match="no answer within"):
            await channel.request(ask(1), 0.05)
        given_up.set()
        await channel.closed.wait()


async def test_what_nobody_waits_for_any_more_is_not_even_decoded(worlds: Worlds) -> None:
    given_up = trio.Event()

    async def serve(connection: Connection) -> None:
        reader = FrameReader()
        [request] = await next_packets(connection, reader)
        await given_up.wait()
        # A malformed packet, which would be complained of.
        await connection.send(frame(bytes([0x94, 37, request.request_id, 0xC0, 0xC3])))
        [request] = await next_packets(connection, reader)
        await connection.send(encode_frame(request))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        with pytest.raises(Unreachable, match="no answer within"):
            await channel.request(ask(1), 0.05)
        given_up.set()
        assert isinstance(await channel.request(ListScenes(), LONG_S), ListScenes)


@pytest.mark.expect_log("malformed packet")
async def test_a_malformed_answer_costs_its_request_and_no_other(worlds: Worlds) -> None:
    async def serve(connection: Connection) -> None:
        reader = FrameReader()
        [request] = await next_packets(connection, reader)
        await connection.send(frame(bytes([0x94, 37, request.request_id, 0xC0, 0xC3])))
        [request] = await next_packets(connection, reader)
        await connection.send(encode_frame(request))
        await connection.receive(1)

    async with channel_to(worlds, serve) as channel:
        with pytest.raises(PeerFault, match="malformed"):
            await channel.request(ask(1), LONG_S)
        assert isinstance(await channel.request(ask(2), LONG_S), RequestPublicKey)


@pytest.mark.expect_log(UNASKED)
async def test_who_was_cut_off_is_talked_to_again_when_there_is_something_to_ask(worlds: Worlds) -> None:
    lives = 0

    async def serve(connection: Connection) -> None:
        nonlocal lives
        lives += 1
        reader = FrameReader()
        [request] = await next_packets(connection, reader)
        await connection.send(encode_frame(replace(request, request_id=7 if lives == 1 else request.request_id)))
        await connection.receive(1)

    async with trio.open_nursery() as nursery:
        await nursery.start(worlds.node(0).network.listen, worlds.address(0), LOW, serve)
        async with open_links(worlds.user("ada")) as links:
            with pytest.raises(Unreachable, match=UNASKED):
                await links.request(worlds.address(0), LOW, ask(1), LONG_S)
            assert isinstance(await links.request(worlds.address(0), LOW, ask(1), LONG_S), RequestPublicKey)
        nursery.cancel_scope.cancel()
