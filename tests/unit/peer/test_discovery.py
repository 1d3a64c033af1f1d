"""If this fails, whoever is on the local network keeps newcomers from finding the cluster, or old tokens still tell where it is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from scenefold.peer.discovery import ANSWERS_PER_S_MAX, CHECKS_PER_S_MAX, Discovery
from scenefold.wire.enrol_entries import Withdraw
from scenefold.world.discovery import Question, pack_question, read_question
from scenefold.world.roll import Roll
from unit.peer.members_made import NOW, invitation_key
from unit.world.test_roll import enrol, invite

EXPIRES = invite(1, "user:ada").expires


class Node:
    """One that knows a log; its clock stands."""

    def __init__(self, roll: Roll, wall: float = NOW.timestamp()) -> None:
        clock = SimpleNamespace(now=lambda: 5.0, wall=lambda: wall)
        world: Any = SimpleNamespace(clock=clock)
        log: Any = SimpleNamespace(registry=SimpleNamespace(roll=roll))
        self.discovery = Discovery(world, SimpleNamespace(), 1, "127.0.0.2", log)  # type: ignore[arg-type]

    def answers(self, question: Question) -> bool:
        return not self.discovery.why_not(question)


def question(number: int = 1) -> Question:
    asked = read_question(pack_question(invitation_key(number), bytes(16)))
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


def test_questions_that_nobody_signed_take_no_answer_away() -> None:
    node = Node(OPEN)
    for _ in range(CHECKS_PER_S_MAX // 2):
        assert not node.answers(replace(question(), signature=bytes(64)))
    assert [node.answers(question()) for _ in range(ANSWERS_PER_S_MAX + 1)] == [True] * ANSWERS_PER_S_MAX + [False]


def test_no_more_signatures_are_looked_at_than_a_node_has_time_for() -> None:
    node = Node(OPEN)
    for _ in range(CHECKS_PER_S_MAX):
        node.answers(replace(question(), signature=bytes(64)))
    assert "too many" in node.discovery.why_not(question())
