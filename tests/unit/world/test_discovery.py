"""If this fails, nodes answer who has no invitation, or a newcomer takes any datagram for an answer."""

from __future__ import annotations

from typing import Any

import trio
import trio.testing
from hypothesis import given
from hypothesis import strategies as st

from loopback import free_ports
from scenefold.base.ids import NodeId, node_id_of
from scenefold.crypto import SigningKey
from scenefold.world import Ports, newcomer_world
from scenefold.world.discovery import pack_answer, pack_question, read_answer, read_question
from scenefold.world.knocking import FOUND_MAX, look_around
from scenefold.world.ports import Endpoint
from scenefold.world.real.broadcasts import broadcasts_of, hear_broadcasts
from scenefold.world.real.datagrams import RealDatagrams

KEY = SigningKey.from_seed(b"k" * 32)
NONCE = b"n" * 16


def test_a_question_says_whose_invitation_and_shows_its_key() -> None:
    question = read_question(pack_question(KEY, NONCE))
    assert question is not None and (question.invitation, question.nonce) == (KEY.public.raw, NONCE) and question.is_signed()
    assert len(pack_answer(NONCE, NodeId(1))) < len(pack_question(KEY, NONCE)), "an answer must never be more than was asked"


@given(st.integers(0, 8 * len(pack_question(KEY, NONCE)) - 1))
def test_no_flipped_bit_of_a_question_passes(bit: int) -> None:
    bent = bytearray(pack_question(KEY, NONCE))
    bent[bit // 8] ^= 1 << bit % 8
    question = read_question(bytes(bent))
    assert question is None or not question.is_signed()


@given(st.binary(max_size=200))
def test_other_datagrams_are_no_questions_and_no_answers(data: bytes) -> None:
    question = read_question(data)
    assert question is None or not question.is_signed()
    assert read_answer(data, NONCE) is None


def test_an_answer_belongs_to_one_question() -> None:
    answer = pack_answer(NONCE, NodeId(7))
    assert read_answer(answer, NONCE) == 7
    assert read_answer(answer, b"o" * 16) is None and read_answer(answer + b"x", NONCE) is None


def test_a_node_of_this_machine_is_reached_by_the_loopbacks_broadcast_only() -> None:
    assert broadcasts_of("127.0.0.9") == ("127.255.255.255",)
    assert broadcasts_of("192.168.7.9") == ("255.255.255.255", "192.168.7.255")


async def test_several_nodes_of_a_machine_hear_the_same_broadcast() -> None:
    port = free_ports(("127.0.0.2",)).high
    first, second = [(await hear_broadcasts(f"127.0.0.{number}", port))[0] for number in (2, 3)]

    async def answer(node: str, heard: RealDatagrams) -> None:
        data, source = await heard.receive()
        question = read_question(data)
        assert question is not None and question.is_signed()
        with trio.socket.socket(type=trio.socket.SOCK_DGRAM) as speaker:
            await speaker.sendto(b"noise", Endpoint(*source))
            await speaker.sendto(pack_answer(b"x" * 16, NodeId(9)), Endpoint(*source))
            await speaker.sendto(pack_answer(question.nonce, node_id_of(node)), Endpoint(*source))

    async with trio.open_nursery() as nursery:
        nursery.start_soon(answer, "127.0.0.2", first)
        nursery.start_soon(answer, "127.0.0.3", second)
        found = await look_around(newcomer_world(Ports(port - 1, port)).network, KEY, NONCE)
    assert set(found) == {node_id_of("127.0.0.2"), node_id_of("127.0.0.3")}
    await first.aclose()
    await second.aclose()


class Room:
    """A network in which somebody near answers for many nodes before anybody else does."""

    def __init__(self, *answers: tuple[str, int]) -> None:
        self._answers = list(answers)

    async def open_broadcasts(self) -> tuple[Room, tuple[str, ...]]:
        return self, ("255.255.255.255",)

    async def send(self, data: bytes, target: str) -> None:
        assert read_question(data) is not None

    async def receive(self) -> tuple[bytes, Endpoint]:
        await trio.lowlevel.checkpoint()
        if not self._answers:
            await trio.sleep_forever()
        source, node = self._answers.pop(0)
        return pack_answer(NONCE, NodeId(node)), Endpoint(source, 17350)

    async def aclose(self) -> None:
        await trio.lowlevel.checkpoint()


async def test_who_answers_for_many_nodes_hides_no_other(autojump_clock: trio.testing.MockClock) -> None:
    liar = [("10.0.0.66", 1_000 + number) for number in range(1_000)]
    room: Any = Room(*liar, ("10.0.0.2", 2), ("10.0.0.3", 3), ("10.0.0.2", 2))
    found = await look_around(room, KEY, NONCE)
    assert found[:3] == [1_000, 2, 3] and len(found) == FOUND_MAX


async def test_whom_one_has_asked_already_hides_nobody_who_answers_later(autojump_clock: trio.testing.MockClock) -> None:
    liars = [(f"10.0.1.{number}", 1_000 + number) for number in range(FOUND_MAX)]
    room: Any = Room(*liars, ("10.0.0.2", 2), *liars)
    assert await look_around(room, KEY, NONCE, passed=[NodeId(number) for _, number in liars]) == [2]


async def test_where_nobody_answers_nobody_is_found() -> None:
    assert await look_around(newcomer_world(free_ports(("127.0.0.2",))).network, KEY, NONCE) == []
