"""If one fails, readers wait for who cannot say yet what a dead node owned, keep it busy with what they wait for no more, or ask others for ever."""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.client.adopters import KEPT_MAX, LEFT_ALONE_S, Adopters, Turn

ADOPTER, OTHER, DEAD, GIVER = (NodeId(number) for number in range(1, 5))
GONE = frozenset({DEAD})


def test_who_adopted_nothing_is_asked_first() -> None:
    assert Adopters().turn(0.0, ADOPTER, frozenset()) is Turn.OWNER


def test_an_adopter_is_asked_now_and_then_until_it_is_sooner() -> None:
    adopters = Adopters()
    assert adopters.turn(0.0, ADOPTER, GONE) is Turn.BOTH
    assert adopters.turn(0.0, ADOPTER, GONE) is Turn.HOLDERS, "one question at a time"
    assert adopters.turn(0.0, OTHER, GONE) is Turn.BOTH, "that says nothing of others"
    adopters.was_late(0.5, ADOPTER, GONE)
    assert adopters.turn(0.4 + LEFT_ALONE_S, ADOPTER, GONE) is Turn.HOLDERS
    assert adopters.turn(0.5 + LEFT_ALONE_S, ADOPTER, GONE) is Turn.BOTH
    adopters.was_sooner(ADOPTER, GONE)
    assert adopters.turn(0.5 + LEFT_ALONE_S, ADOPTER, GONE) is Turn.OWNER
    adopters.was_late(9.0, ADOPTER, GONE)
    assert adopters.turn(9.0, ADOPTER, GONE) is Turn.HOLDERS, "one part of it may be told before another"


def test_a_question_that_ends_without_an_answer_is_followed_by_another() -> None:
    adopters = Adopters()
    assert [adopters.turn(at * LEFT_ALONE_S, ADOPTER, GONE) for at in range(3)] == [Turn.BOTH] * 3


def test_what_is_known_of_places_of_one_says_nothing_of_those_of_another() -> None:
    adopters = Adopters()
    adopters.was_sooner(ADOPTER, GONE)
    assert adopters.turn(1.0, ADOPTER, {DEAD, GIVER}) is Turn.BOTH
    assert adopters.turn(1.0, ADOPTER, {DEAD, GIVER}) is Turn.HOLDERS
    assert adopters.turn(1.0, ADOPTER, GONE) is Turn.OWNER


def test_what_is_remembered_is_bounded_and_what_was_not_used_longest_goes_first() -> None:
    adopters = Adopters()
    for number in range(KEPT_MAX):
        adopters.was_sooner(ADOPTER, {NodeId(number + 2)})
    adopters.was_sooner(ADOPTER, {NodeId(2)})
    adopters.was_sooner(OTHER, {NodeId(1)})
    turns = [adopters.turn(0.0, ADOPTER, {NodeId(number)}) for number in (2, 4, 3)]
    assert turns == [Turn.OWNER, Turn.OWNER, Turn.BOTH]
