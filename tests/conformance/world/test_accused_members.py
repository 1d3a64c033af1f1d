"""If this fails, a member that sends nonsense pays nothing beside other members, or pays for what others had it pass on."""

from __future__ import annotations

import pytest
import trio

from conformance.world.makers import Worlds
from conformance.world.test_channels import LONG_S, LOW, ask, connect, echo, next_packets, raw_connection
from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, frame
from scenefold.world import Connection, open_channel, serve_connection
from scenefold.world.guests import Guests
from scenefold.world.serving import Handler
from scenefold.world.shares import Kind
from scenefold.world.turns import Turns

MEMBER = "user:ada"
"""Whoever `connect` connects as: here a member."""


async def served(worlds: Worlds, nursery: trio.Nursery, handler: Handler) -> Turns:
    turns = Turns(lambda peer: peer == MEMBER)
    guests = Guests(turns)

    async def serve(connection: Connection) -> None:
        await serve_connection(connection, handler, guests=guests)

    await nursery.start(worlds.node(0).network.listen, worlds.address(0), LOW, serve)
    assert turns.kind_of(MEMBER, trio.current_time()) is Kind.MEMBER
    return turns


@pytest.mark.expect_log("malformed packet")
async def test_a_packet_that_is_none_costs_a_member_its_freedom(worlds: Worlds) -> None:
    async with trio.open_nursery() as nursery:
        turns = await served(worlds, nursery, echo)
        async with raw_connection(worlds) as connection:
            await connection.send(frame(bytes([0x93, 0xCC, 0xF0, 77, 0xC0])))
            [fault] = await next_packets(connection, FrameReader())
            assert isinstance(fault, Fault) and fault.reason == RejectReason.ILL_FORMED
            assert turns.kind_of(MEMBER, trio.current_time()) is Kind.ACCUSED
        nursery.cancel_scope.cancel()


@pytest.mark.expect_log("malformed packet")
async def test_what_a_packet_holds_may_be_others_words(worlds: Worlds) -> None:
    async def opens_what_it_holds(_packet: Packet, _peer: str) -> Packet:
        raise MalformedPacket("order", "no order")

    async with trio.open_nursery() as nursery:
        turns = await served(worlds, nursery, opens_what_it_holds)
        async with open_channel(await connect(worlds)) as channel:
            for number in range(20):
                with pytest.raises(Refused) as caught:
                    await channel.request(ask(number), LONG_S)
                assert caught.value.reason is RejectReason.ILL_FORMED
        assert turns.kind_of(MEMBER, trio.current_time()) is Kind.MEMBER
        nursery.cancel_scope.cancel()
