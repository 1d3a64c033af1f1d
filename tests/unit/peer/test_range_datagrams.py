"""If this fails, a range asked for by datagram is incomplete, comes from a stranger, or one node can be flooded by a repeated question."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from random import Random
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import MemberSecrets, SealingKey, SealingPublicKey, SigningKey
from scenefold.peer.datagrams import Exchange
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.records.range_datagrams import ANSWERERS, QUESTIONS_MAX, RangeDatagrams
from scenefold.wire import Packet, QueryRange, RejectRange, RequestState, ReturnRange, decode_packet, encode_packet
from scenefold.world import Datagrams, Priority
from scenefold.world.sim import CALM, Weather
from unit.peer.data_nodes import LEFT, RIGHT, SCENE, Neighbours, Node, arc, item, managed_item, with_nodes
from unit.peer.scenes_made import SPACE

CLUSTER = b"c" * 16
SECRETS = {
    NodeId(167772161 + index): MemberSecrets(SigningKey.from_seed(bytes([index]) * 32), SealingKey(bytes([index + 1]) * 32))
    for index in range(3)
}
ASKER = NodeId(167772163)
"""A member that asks and serves nothing."""
PATIENCE_S = 0.3


class Members:
    """A registry of the keys above."""

    def current(self, node: NodeId) -> Any:
        secrets = SECRETS.get(node)
        return None if secrets is None else SimpleNamespace(sealing_key=secrets.sealing.public)


def key_of(node: NodeId) -> SealingPublicKey:
    return SECRETS[node].sealing.public if node in SECRETS else SealingKey(node.to_bytes(4, "big") * 8).public


def question_of(piece: Arc, scene: Any = SCENE.scene, request_id: int = 1) -> QueryRange:
    return QueryRange(scene, SPACE, piece.first, piece.last, request_id=request_id)


@dataclass
class Asker:
    """Another implementation's node: it asks again what gets lost, and halves what does not fit."""

    socket: Datagrams
    owner: NodeId
    counter: int = 0
    largest_bytes: int = 0
    port: int = 0
    exchange: Exchange = field(init=False)

    def __post_init__(self) -> None:
        self.exchange = Exchange(ASKER, CLUSTER, self.port, SECRETS[ASKER].sealing, key_of, Random(1).randbytes)

    def sealed(self, packet: Packet, *, target: NodeId | None = None) -> bytes:
        self.counter += 1
        data = self.exchange.seal(target or self.owner, encode_packet(packet))
        assert data is not None
        return data

    async def send(self, *datagrams: bytes) -> None:
        for data in datagrams:
            await self.socket.send(data, address_of(self.owner))

    async def answer(self) -> Packet:
        """The next packet of the owner; what it challenges is answered on the way."""
        while True:
            data, source = await self.socket.receive()
            self.largest_bytes = max(self.largest_bytes, len(data))
            sender, taken = self.exchange.take(data, source.address, trio.current_time())
            assert sender == self.owner
            await self.send(*taken.replies)
            if taken.packets:
                (packet,) = taken.packets
                return decode_packet(packet)

    async def introduce(self) -> None:
        """Until both know that the other one lives."""
        await self.ask(question_of(RIGHT))
        # In virtual time: what both said while they met has arrived.
        await trio.sleep(1.0)

    async def ask(self, question: QueryRange) -> ReturnRange | RejectRange:
        question = replace(question, request_id=self.counter + 1)
        while True:
            await self.send(self.sealed(question))
            with trio.move_on_after(PATIENCE_S):
                while True:
                    answer = await self.answer()
                    if answer.request_id == question.request_id:
                        assert isinstance(answer, ReturnRange | RejectRange)
                        return answer

    async def entries(self, piece: Arc) -> list[tuple[int, bytes]]:
        answer = await self.ask(question_of(piece))
        if isinstance(answer, ReturnRange):
            assert (answer.first, answer.last) == (piece.first, piece.last) and not answer.stale
            objects = answer.objects or (b"",) * len(answer.locations)
            return [(location.number, name) for location, name in zip(answer.locations, objects, strict=True)]
        assert answer.reason == RejectReason.TOO_LARGE_FOR_PACKET
        middle = (piece.first.number + piece.last.number) // 2
        return [*await self.entries(arc(piece.first.number, middle)), *await self.entries(arc(middle + 1, piece.last.number))]


def asking(
    test: Callable[[Asker, Node, RangeDatagrams], Awaitable[None]], *, seed: int = 1, weather: Weather = CALM, limit_s: float = 1000.0
) -> None:
    """Play a test against a node that owns the right half of the line."""

    async def main(neighbours: Neighbours, _: Node, owner: Node) -> None:
        neighbours.net.set_weather(weather)
        own = OwnStatus(owner.me, address_of(owner.me), bytes(16), 1, SECRETS[owner.me])
        answering = RangeDatagrams(owner.world, own, CLUSTER, Members, owner.data.ranges)  # type: ignore[arg-type]
        socket = await neighbours.net.world(f"node:{ASKER}", address_of(ASKER)).network.open_datagrams(address_of(ASKER), Priority.LOW)
        async with trio.open_nursery() as nursery:
            await nursery.start(answering.run)
            with trio.fail_after(limit_s):
                await test(Asker(socket, owner.me), owner, answering)
            nursery.cancel_scope.cancel()
        await socket.aclose()

    with_nodes(main, LEFT, RIGHT, seed=seed)


def test_a_long_range_comes_in_halves_and_whole() -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        numbers = [RIGHT.first.number + index * index for index in range(300)]
        await owner.data.writes.put([item(number) for number in numbers])
        answer = await asker.ask(question_of(RIGHT))
        assert isinstance(answer, RejectRange) and answer.reason == RejectReason.TOO_LARGE_FOR_PACKET
        assert await asker.entries(RIGHT) == [(number, b"") for number in numbers]
        assert len(await asker.entries(arc(numbers[0], numbers[40]))) == 41
        assert DATAGRAM_BYTES_MAX // 2 < asker.largest_bytes <= DATAGRAM_BYTES_MAX

    asking(test)


def test_objects_come_with_their_places() -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        objects = [b"\x90" + bytes([index]) * 15 for index in range(60)]
        await owner.data.writes.put([managed_item(object_id) for object_id in objects])
        assert [name for _, name in await asker.entries(RIGHT)] == objects

    asking(test)


def test_a_part_of_the_range_is_answered_and_named() -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        await owner.data.writes.put([item(RIGHT.first.number + 3)])
        answer = await asker.ask(question_of(arc(LEFT.last.number - 5, RIGHT.first.number + 9)))
        assert isinstance(answer, ReturnRange)
        assert (answer.first, answer.last) == (RIGHT.first, Location.from_number(RIGHT.first.number + 9))
        assert [location.number for location in answer.locations] == [RIGHT.first.number + 3]

    asking(test)


@pytest.mark.expect_log("10.0.0.3: (an internal error, OverflowError|a datagram is dropped: the disk)")
@pytest.mark.parametrize("error", [OverflowError("a bug"), LocalFault("the disk has changed under us")])
def test_a_question_over_which_a_node_fails_ends_it_not(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        await asker.introduce()
        answer = owner.data.ranges.answer

        async def failing(*_args: Any, **_options: Any) -> Any:
            monkeypatch.setattr(owner.data.ranges, "answer", answer)
            raise error

        monkeypatch.setattr(owner.data.ranges, "answer", failing)
        assert isinstance(await asker.ask(question_of(RIGHT)), ReturnRange), "it was asked again"

    asking(test)


def test_what_an_owner_cannot_say_is_a_reason() -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        async def reason(piece: Any, scene: Any = SCENE.scene) -> int:
            answer = await asker.ask(question_of(piece, scene))
            assert isinstance(answer, RejectRange)
            return answer.reason

        assert await reason(LEFT) == RejectReason.OUTSIDE_BOUNDS
        assert await reason(RIGHT, 5) == RejectReason.UNKNOWN_SCENE_OR_SPACE
        owner.lease.held = False
        assert await reason(RIGHT) == RejectReason.NOT_READY
        await owner.data.writes.put([item(RIGHT.first.number)])
        owner.lease.held = True
        await owner.data.writes.put([item(RIGHT.first.number)])
        owner.lease.held = False
        answer = await asker.ask(question_of(RIGHT))
        assert isinstance(answer, ReturnRange) and answer.stale and len(answer.locations) == 1

    asking(test)


@pytest.mark.expect_log("a datagram is dropped|has no business here")
def test_strangers_repetitions_and_other_packets_are_dropped() -> None:
    async def test(asker: Asker, owner: Node, answering: RangeDatagrams) -> None:
        await asker.introduce()
        before, question = answering.dropped, question_of(RIGHT)
        stranger = Exchange(NodeId(99), CLUSTER, 0, SealingKey(b"z" * 32), key_of, Random(2).randbytes)
        thief = Exchange(ASKER, CLUSTER, 0, SealingKey(b"z" * 32), key_of, Random(2).randbytes)
        other_port = Asker(asker.socket, asker.owner, port=1)
        good = asker.sealed(question)
        bad = [
            asker.sealed(question, target=NodeId(167772161)),
            stranger.seal(owner.me, encode_packet(question)) or b"",
            thief.seal(owner.me, encode_packet(question)) or b"",
            other_port.sealed(question),
            asker.sealed(RequestState(request_id=1)),
            asker.sealed(RejectRange(SCENE.scene, SPACE, RIGHT.first, RejectReason.NOT_READY, request_id=1)),
            good[:90],
            b"",
        ]
        await asker.send(good, *bad, good)
        assert isinstance(await asker.answer(), ReturnRange)
        with trio.move_on_after(5):
            raise AssertionError(f"answered twice: {await asker.answer()}")
        assert answering.dropped - before == len(bad) + 1

    asking(test)


@pytest.mark.expect_log("a datagram is dropped: it is of version 3, this node takes version 2")
def test_a_question_of_a_later_version_is_dropped_and_its_version_named(caplog: pytest.LogCaptureFixture) -> None:
    async def test(asker: Asker, _owner: Node, answering: RangeDatagrams) -> None:
        await asker.introduce()
        before = answering.dropped
        later = [b"SFD3" + asker.sealed(question_of(RIGHT))[4:] for _ in range(4)]
        await asker.send(*later, asker.sealed(question_of(RIGHT)))
        assert isinstance(await asker.answer(), ReturnRange)
        assert answering.dropped - before == 4
        assert sum("of version 3" in record.getMessage() for record in caplog.records) == 1

    asking(test)


@pytest.mark.expect_log("there are too many")
def test_more_questions_than_can_wait_are_dropped_and_the_others_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(asker: Asker, owner: Node, answering: RangeDatagrams) -> None:
        answer, may_answer = owner.data.ranges.answer, trio.Event()

        async def answer_late(*args: Any, **options: Any) -> Any:
            await may_answer.wait()
            return await answer(*args, **options)

        monkeypatch.setattr(owner.data.ranges, "answer", answer_late)
        places, more = QUESTIONS_MAX + ANSWERERS, 10
        may_answer.set()
        await asker.introduce()
        may_answer = trio.Event()
        before = answering.dropped
        for number in range(places + more):
            await asker.send(asker.sealed(question_of(RIGHT, request_id=number + 1)))
            await trio.sleep(0.1)
        assert answering.dropped - before == more
        may_answer.set()
        assert {(await asker.answer()).request_id for _ in range(places)} == set(range(1, places + 1))

    asking(test)


def test_lost_datagrams_are_asked_for_again() -> None:
    async def test(asker: Asker, owner: Node, _: RangeDatagrams) -> None:
        for _turn in range(20):
            assert await asker.entries(RIGHT) == []

    for seed in range(3):
        asking(test, seed=seed, weather=replace(CALM, loss=0.1, duplication=0.2, reordering=0.1))
