"""If this fails, a range asked for by datagram is incomplete, comes from a stranger, or one node can be flooded by a repeated question."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey, sign_datagram
from scenefold.peer.range_datagrams import Entry, RangeDatagrams
from scenefold.peer.status import OwnStatus
from scenefold.wire import QueryRange, RejectRange, encode_packet
from scenefold.world import Priority
from scenefold.world.sim import CALM, Weather
from unit.peer.data_nodes import LEFT, RIGHT, SCENE, Neighbours, Node, arc, item, managed_item, with_nodes
from unit.peer.scenes_made import SPACE

KEYS = {NodeId(167772161 + index): SigningKey.from_seed(bytes([index]) * 32) for index in range(3)}


class Members:
    """A registry of the keys above."""

    def current(self, node: NodeId) -> Any:
        key = KEYS.get(node)
        return None if key is None else SimpleNamespace(incarnation=bytes(16), key=key.public)


def with_ports(
    test: Callable[[Node, RangeDatagrams, Node, RangeDatagrams], Awaitable[None]], *, seed: int = 1, weather: Weather = CALM
) -> None:
    async def main(neighbours: Neighbours, one: Node, other: Node) -> None:
        neighbours.net.set_weather(weather)
        ports = [
            RangeDatagrams(
                node.world,
                OwnStatus(node.me, address_of(node.me), bytes(16), 1, KEYS[node.me]),
                Members,  # type: ignore[arg-type]
                node.data.ranges,
            )
            for node in (one, other)
        ]
        async with trio.open_nursery() as nursery:
            for port in ports:
                await nursery.start(port.run)
            await test(one, ports[0], other, ports[1])
            nursery.cancel_scope.cancel()

    with_nodes(main, LEFT, RIGHT, seed=seed)


def test_a_long_range_comes_in_halves_and_whole() -> None:
    async def test(_: Node, asker: RangeDatagrams, owner: Node, __: RangeDatagrams) -> None:
        numbers = [RIGHT.first.number + index * index for index in range(300)]
        await owner.data.writes.put([item(number) for number in numbers])
        assert await asker.entries(owner.me, SCENE.scene, SPACE, RIGHT) == [Entry(Location.from_number(number), b"") for number in numbers]
        question = QueryRange(SCENE.scene, SPACE, RIGHT.first, RIGHT.last)
        answer = await asker.ask(owner.me, question)
        assert isinstance(answer, RejectRange) and answer.reason == RejectReason.TOO_LARGE_FOR_PACKET
        piece = arc(numbers[0], numbers[40])
        assert len(await asker.entries(owner.me, SCENE.scene, SPACE, piece)) == 41

    with_ports(test)


def test_objects_come_with_their_places() -> None:
    async def test(_: Node, asker: RangeDatagrams, owner: Node, __: RangeDatagrams) -> None:
        objects = [b"\x90" + bytes([index]) * 15 for index in range(60)]
        await owner.data.writes.put([managed_item(object_id) for object_id in objects])
        assert [entry.object for entry in await asker.entries(owner.me, SCENE.scene, SPACE, RIGHT)] == objects

    with_ports(test)


def test_what_an_owner_cannot_say_is_a_reason() -> None:
    async def test(_: Node, asker: RangeDatagrams, owner: Node, __: RangeDatagrams) -> None:
        async def reason(piece: Any, scene: Any = SCENE.scene) -> RejectReason:
            with pytest.raises(Refused) as caught:
                await asker.entries(owner.me, scene, SPACE, piece)
            return caught.value.reason

        assert await reason(LEFT) is RejectReason.OUTSIDE_BOUNDS
        assert await reason(arc(LEFT.last.number, RIGHT.first.number)) is RejectReason.OUTSIDE_BOUNDS
        assert await reason(RIGHT, 5) is RejectReason.UNKNOWN_SCENE_OR_SPACE
        owner.lease.held = False
        assert await reason(RIGHT) is RejectReason.NOT_READY
        await owner.store.merge([])

    with_ports(test)


@pytest.mark.expect_log("a datagram is dropped")
def test_strangers_and_repetitions_are_dropped() -> None:
    async def test(one: Node, asker: RangeDatagrams, owner: Node, answerer: RangeDatagrams) -> None:
        question = encode_packet(QueryRange(SCENE.scene, SPACE, RIGHT.first, RIGHT.last, request_id=1))
        known = KEYS[NodeId(167772163)]
        member, stranger = NodeId(167772163), NodeId(99)
        good = sign_datagram(known, member, 7, question, target=owner.me)
        assert len(good) < DATAGRAM_BYTES_MAX
        socket = await one.world.network.open_datagrams(None, Priority.LOW)
        for data in (
            good,
            good,
            sign_datagram(known, member, 8, question),
            sign_datagram(known, stranger, 9, question, target=owner.me),
            sign_datagram(SigningKey.from_seed(b"z" * 32), member, 10, question, target=owner.me),
            good[:90],
            b"",
        ):
            await socket.send(data, address_of(owner.me))
        await trio.sleep(5)
        assert answerer.dropped >= 5
        await socket.aclose()

    with_ports(test)


def test_a_silent_owner_is_an_error_in_bounded_time() -> None:
    async def test(_: Node, asker: RangeDatagrams, __: Node, ___: RangeDatagrams) -> None:
        with trio.fail_after(5), pytest.raises(Unreachable):
            await asker.ask(NodeId(167772163), QueryRange(SCENE.scene, SPACE, RIGHT.first, RIGHT.last))

    with_ports(test)


@pytest.mark.expect_log("a datagram is dropped")
def test_lost_datagrams_are_sent_again() -> None:
    async def test(_: Node, asker: RangeDatagrams, owner: Node, __: RangeDatagrams) -> None:
        for _turn in range(20):
            assert await asker.entries(owner.me, SCENE.scene, SPACE, RIGHT) == []

    for seed in range(3):
        with_ports(test, seed=seed, weather=replace(CALM, loss=0.1, duplication=0.2, reordering=0.1))
