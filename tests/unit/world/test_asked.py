"""If this failed, honest answers would end a connection, answers to nothing would not, or two requests would have one id."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.world.asked import GIVEN_UP_MAX, Asked

STEPS = st.lists(st.tuples(st.sampled_from(["ask", "give up", "withdraw", "answer"]), st.integers(0, 20)), max_size=60)


@given(STEPS)
def test_each_request_is_answered_once_and_nothing_else_is(steps: list[tuple[str, int]]) -> None:
    asked = Asked[str]()
    numbers: list[int] = []
    waiting: dict[int, str] = {}
    late: set[int] = set()
    for step, which in steps:
        if step == "ask":
            who = str(len(numbers))
            number = asked.ask(who)
            assert number and number not in waiting and number not in late
            numbers.append(number)
            waiting[number] = who
            continue
        number = numbers[which] if which < len(numbers) else 1000 + which
        if step == "answer":
            if number in waiting:
                assert asked.answered(number) == waiting.pop(number)
            elif number in late:
                late.remove(number)
                assert asked.answered(number) is None
            else:
                with pytest.raises(PeerFault):
                    asked.answered(number)
        else:
            if number in waiting and step == "give up":
                late.add(number)
            waiting.pop(number, None)
            asked.give_up(number, was_sent=step == "give up")
        assert list(asked.waiting) == list(waiting.values())


def test_of_many_given_up_the_oldest_are_forgotten() -> None:
    asked = Asked[str]()
    numbers = [asked.ask("") for _ in range(GIVEN_UP_MAX + 1)]
    for number in numbers:
        asked.give_up(number, was_sent=True)
    with pytest.raises(PeerFault):
        asked.answered(numbers[0])
    assert all(asked.answered(number) is None for number in numbers[1:])


def test_what_has_no_id_or_none_of_a_request_is_no_answer() -> None:
    asked = Asked[str]()
    asked.ask("somebody")
    for number in (None, 0):
        with pytest.raises(PeerFault):
            asked.answered(number)


def test_ids_begin_again_and_pass_over_those_that_are_awaited_still(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.world.asked._ID_MODULUS", 4)
    asked = Asked[int]()
    assert [asked.ask(who) for who in range(2)] == [1, 2]
    asked.give_up(1, was_sent=True)
    assert asked.ask(2) == 3
    assert asked.answered(2) == 1
    assert asked.ask(3) == 2, "0 belongs to nobody, 1 may still be answered, 3 is awaited"
