"""If this fails, nodes answer who has no invitation, or a newcomer takes any datagram for an answer."""

from __future__ import annotations

from collections.abc import Sequence
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
from scenefold.world.knocking import look_around
from scenefold.world.nearby import FOUND_MAX, SOURCES_MAX, Nearby
from scenefold.world.ports import Endpoint
from scenefold.world.real.broadcasts import broadcasts_of, hear_broadcasts
from scenefold.world.real.datagrams import RealDatagrams
from scenefold.world.sim.entropy import SimEntropy

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
        found = await look_around(newcomer_world(Ports(port - 1, port)).network, KEY, SimEntropy(0, "newcomer"))
    assert set(found) == {node_id_of("127.0.0.2"), node_id_of("127.0.0.3")}
    await first.aclose()
    await second.aclose()


class Room:
    """A network in which somebody near answers for many nodes before anybody else does."""

    def __init__(self, *answers: tuple[str, NodeId]) -> None:
        self._answers = list(answers)
        self._nonce = b""

    async def open_broadcasts(self) -> tuple[Room, tuple[str, ...]]:
        return self, ("255.255.255.255",)

    async def send(self, data: bytes, target: str) -> None:
        question = read_question(data)
        assert question is not None and question.is_signed()
        self._nonce = question.nonce

    async def receive(self) -> tuple[bytes, Endpoint]:
        await trio.lowlevel.checkpoint()
        if not self._answers:
            await trio.sleep_forever()
        source, node = self._answers.pop(0)
        return pack_answer(self._nonce, node), Endpoint(source, 17350)

    async def aclose(self) -> None:
        await trio.lowlevel.checkpoint()


def of_itself(*addresses: str) -> list[tuple[str, NodeId]]:
    return [(address, node_id_of(address)) for address in addresses]


async def found_in(*answers: tuple[str, NodeId], passed: Sequence[NodeId] = (), seed: int = 0) -> list[NodeId]:
    room: Any = Room(*answers)
    return await look_around(room, KEY, SimEntropy(seed, "newcomer"), passed=passed)


async def test_who_answers_for_many_nodes_hides_no_other(autojump_clock: trio.testing.MockClock) -> None:
    liar = [("10.0.0.66", NodeId(1_000 + number)) for number in range(1_000)]
    honest = of_itself("10.0.0.2", "10.0.0.3", "10.0.0.2")
    found = await found_in(*liar, *honest)
    assert {node for _, node in honest} == set(found[:2]) and 2 < len(found) <= FOUND_MAX


async def test_who_names_itself_is_asked_before_whom_others_name(autojump_clock: trio.testing.MockClock) -> None:
    liars = [(f"10.0.1.{number}", NodeId(1_000 + number)) for number in range(SOURCES_MAX)]
    assert (await found_in(*liars, *of_itself("10.0.0.2")))[0] == node_id_of("10.0.0.2")


async def test_who_answers_first_from_many_addresses_does_not_hide_who_answers_later(autojump_clock: trio.testing.MockClock) -> None:
    """Whoever can answer from one forged address can from hundreds: then it is chance who is asked, not who was quicker."""
    honest = node_id_of("10.0.0.2")
    few, many = (of_itself(*(f"10.0.{1 + number // 250}.{number % 250}" for number in range(count))) for count in (8, 2 * SOURCES_MAX))
    assert honest in await found_in(*few, *of_itself("10.0.0.2"))
    looks = [await found_in(*many, *of_itself("10.0.0.2"), *many, seed=seed) for seed in range(100)]
    assert all(len(found) == FOUND_MAX for found in looks)
    assert sum(honest in found for found in looks) >= 100 * FOUND_MAX // (2 * SOURCES_MAX) // 2, "half of its fair share, at least"


async def test_whom_one_has_asked_already_hides_nobody_who_answers_later(autojump_clock: trio.testing.MockClock) -> None:
    liars = of_itself(*(f"10.0.1.{number}" for number in range(FOUND_MAX)))
    honest = of_itself("10.0.0.2")
    assert await found_in(*liars, *honest, *liars, passed=[node for _, node in liars]) == [honest[0][1]]


@given(
    st.lists(
        st.tuples(st.sampled_from([f"10.0.{one}.{two}" for one in (0, 1) for two in range(SOURCES_MAX // 2)]), st.integers(1, 2**32 - 1))
    )
)
def test_the_order_and_the_number_of_answers_choose_nobody(answers: list[tuple[str, int]]) -> None:
    once, shuffled = Nearby(b"chance"), Nearby(b"chance")
    for source, node in answers:
        once.hear(source, NodeId(node))
    for source, node in [*reversed(answers), *answers]:
        shuffled.hear(source, NodeId(node))
    assert once.chosen() == shuffled.chosen()
    assert len(once.chosen()) <= FOUND_MAX and len(set(once.chosen())) == len(once.chosen())


async def test_where_nobody_answers_nobody_is_found() -> None:
    assert await look_around(newcomer_world(free_ports(("127.0.0.2",))).network, KEY, SimEntropy(0, "newcomer")) == []
