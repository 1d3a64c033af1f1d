"""If one fails, readers wait for a slow node as if that were usual, or ask others about everything."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.client.tail import BEHIND, KEPT, LEAST, PATIENT_S, SPARE_MAX, SPARE_PART, Tails

ONE, TWO, THREE, FOUR, SLOW = (NodeId(number) for number in range(1, 6))
QUICK = (ONE, TWO, THREE, FOUR)


def tails() -> Tails:
    return Tails(unknown_s=0.5, least_s=0.01, most_s=2.0)


def test_the_limit_is_where_one_answer_in_twenty_begins() -> None:
    known = tails()
    for _ in range(LEAST - 1):
        known.note(ONE, 1, 0.1)
    assert known.limit_s(1) == 0.5, "too few are known"
    for number in range(KEPT):
        known.note(ONE, 1, 0.1 if number % 10 else 0.3)
    assert known.limit_s(1) == 0.3
    for number in range(KEPT):
        known.note(ONE, 1, 0.1 if number % 40 else 0.3)
    assert known.limit_s(1) == 0.1
    for seconds, limit_s in ((0.001, 0.01), (9.0, 2.0)):
        for _ in range(KEPT):
            known.note(ONE, 1, seconds)
        assert known.limit_s(1) == limit_s


def test_one_node_that_is_always_slow_does_not_say_what_is_slow() -> None:
    known = tails()
    for _ in range(KEPT):
        for node in QUICK:
            known.note(node, 1, 0.02)
        known.note(SLOW, 1, 0.7)
    assert known.limit_s(1) == 0.02


@given(st.lists(st.floats(0.01, 2.0), min_size=1, max_size=9))
def test_the_limit_is_that_of_the_faster_half(usual: list[float]) -> None:
    known = tails()
    for number, seconds in enumerate(usual):
        for _ in range(LEAST):
            known.note(NodeId(number), 1, seconds)
    limit_s = known.limit_s(1)
    assert sum(seconds <= limit_s for seconds in usual) >= (len(usual) + 1) // 2
    assert sum(seconds < limit_s for seconds in usual) <= (len(usual) - 1) // 2


def test_questions_for_many_records_say_nothing_of_questions_for_few_unless_nothing_else_is_known() -> None:
    known = tails()
    for _ in range(LEAST):
        known.note(ONE, 64, 0.4)
    assert known.limit_s(1) == 0.4, "it does not take longer than that"
    for _ in range(LEAST):
        known.note(ONE, 1, 0.02)
    assert (known.limit_s(1), known.limit_s(40)) == (0.02, 0.4)
    assert tails().limit_s(40) == 0.5


def test_who_is_late_again_and_again_is_behind_until_it_is_sooner_once() -> None:
    known = tails()
    for _ in range(BEHIND):
        assert not known.is_behind(SLOW)
        known.was_late(SLOW)
    assert known.is_behind(SLOW) and not known.is_behind(ONE)
    known.note(SLOW, 1, 0.01)
    assert not known.is_behind(SLOW)


def test_where_all_are_slow_only_some_questions_are_asked_twice() -> None:
    known = tails()
    for _ in range(int(SPARE_MAX)):
        assert known.limit_s(1) == 0.5
        known.asked_others()
    assert known.limit_s(1) == PATIENT_S
    asked = 0
    for _ in range(400):
        known.note(ONE, 1, 1.0)
        if known.limit_s(1) < PATIENT_S:
            known.asked_others()
            asked += 1
    assert asked == 400 * SPARE_PART
