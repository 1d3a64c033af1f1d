"""If this fails, whoever is on the local network keeps newcomers from finding the cluster, or old tokens still tell where it is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.peer.enrolment.discovery import ANSWERS_OF_QUESTION, ANSWERS_PER_S_MAX, CHECKS_OF_SOURCE, CHECKS_PER_S_MAX, Discovery
from scenefold.wire.enrol_entries import Withdraw
from scenefold.world.discovery import Question, pack_question, read_question
from scenefold.world.ports import Endpoint
from scenefold.world.roll import Roll
from unit.peer.members_made import NOW, invitation_key
from unit.world.test_roll import enrol, invite

EXPIRES = invite(1, "user:ada").expires
NEAR, ELSEWHERE = "192.168.1.7", "192.168.1.8"


class Node:
    """One that knows a log; its clock stands."""

    def __init__(self, roll: Roll, wall: float = NOW.timestamp()) -> None:
        clock = SimpleNamespace(now=lambda: 5.0, wall=lambda: wall)
        world: Any = SimpleNamespace(clock=clock)
        log: Any = SimpleNamespace(registry=SimpleNamespace(roll=roll))
        self.discovery = Discovery(world, SimpleNamespace(), 1, "127.0.0.2", log)  # type: ignore[arg-type]

    def answers(self, question: Question, source: str = NEAR) -> bool:
        return not self.discovery.why_not(question, source)


def question(number: int = 1, nonce: int = 0) -> Question:
    asked = read_question(pack_question(invitation_key(number), nonce.to_bytes(16, "big")))
    assert asked is not None
    return asked


OPEN = Roll().after(invite(1, "user:ada"))


def test_only_who_has_a_token_that_counts_is_answered() -> None:
    assert Node(OPEN).answers(question())
    assert not Node(OPEN).answers(question(2))
    assert not Node(OPEN, EXPIRES + 1).answers(question())
    assert not Node(OPEN.after(Withdraw(invitation_key(1).public.raw))).answers(question())
    assert not Node(OPEN).answers(replace(question(), signature=bytes(64)))
    used = OPEN.after(enrol(1, "user:ada"))
    assert Node(used).answers(question()), "its holder may not have heard the answer"
    assert not Node(used, EXPIRES + 1).answers(question())


@pytest.mark.expect_log("an internal error, KeyError")
async def test_a_broadcast_over_which_a_node_fails_ends_it_not(monkeypatch: pytest.MonkeyPatch) -> None:
    node, answers = Node(OPEN), list[bytes]()
    data, why_not = pack_question(invitation_key(1), bytes(16)), node.discovery.why_not
    arriving = [data, data]

    def failing(*_: object) -> str:
        monkeypatch.setattr(node.discovery, "why_not", why_not)
        raise KeyError

    class Speaker:
        async def receive(self) -> tuple[bytes, Endpoint]:
            await trio.lowlevel.checkpoint()
            if not arriving:
                raise EOFError
            return arriving.pop(), Endpoint(NEAR, 1)

        async def send(self, answer: bytes, _target: object) -> None:
            await trio.lowlevel.checkpoint()
            answers.append(answer)

    monkeypatch.setattr(node.discovery, "why_not", failing)
    with pytest.raises(EOFError):
        await node.discovery._listen(Speaker(), Speaker())  # type: ignore[arg-type]
    assert len(answers) == 1 and not node.discovery.dropped
    arriving += [b"noise", pack_question(invitation_key(2), bytes(16)), data]
    with pytest.raises(EOFError):
        await node.discovery._listen(Speaker(), Speaker())  # type: ignore[arg-type]
    assert len(answers) == 2 and node.discovery.dropped == 2, "what is not answered is counted"


FORGED = replace(question(), signature=bytes(64))


def test_questions_that_nobody_signed_take_no_answer_away() -> None:
    node = Node(OPEN)
    for _ in range(CHECKS_OF_SOURCE // 2):
        assert not node.answers(FORGED)
    assert node.answers(question())


def test_no_more_signatures_are_looked_at_than_a_node_has_time_for_and_of_one_address_only_some() -> None:
    node = Node(OPEN)
    for _ in range(2 * CHECKS_PER_S_MAX):
        assert not node.answers(FORGED, ELSEWHERE)
    assert node.answers(question()), "who floods has taken its own share"
    for number in range(CHECKS_PER_S_MAX):
        assert not node.answers(FORGED, f"10.0.0.{number}")
    assert "too many" in node.discovery.why_not(question(nonce=1), NEAR)


def test_a_question_that_was_overheard_is_answered_a_few_times() -> None:
    node = Node(OPEN)
    assert sum(node.answers(question(), f"10.0.0.{number}") for number in range(50)) == ANSWERS_OF_QUESTION
    assert node.answers(question(nonce=1))


def test_questions_that_were_overheard_keep_nobody_from_an_answer() -> None:
    node = Node(OPEN.after(invite(2, "user:ben")))
    for nonce in range(40):
        node.answers(question(1, nonce), ELSEWHERE)
    assert node.answers(question(1, 99)), "one address has its share only"
    for nonce in range(40):
        node.answers(question(1, nonce), f"10.0.0.{nonce}")
    assert not node.answers(question(1, 98)) and node.answers(question(2)), "and so has one invitation"


def test_all_in_all_so_many_are_answered_in_a_second() -> None:
    roll = OPEN
    for number in range(2, 10):
        roll = roll.after(invite(number, f"user:u{number}"))
    node = Node(roll)
    asked = [(number, nonce) for nonce in range(6) for number in range(1, 10)]
    answered = sum(node.answers(question(number, nonce), f"10.0.{number}.{nonce}") for number, nonce in asked)
    assert answered == ANSWERS_PER_S_MAX
