"""If this fails, the judge of what clients were told of a scene's log lets lies pass, or blames what is true."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.simulation import laws
from scenefold.simulation.log_history import Attempt, LogHistory, Told, wrong_answers

REQUESTS = [bytes([number]) * 16 for number in range(1, 7)]
STEPS = st.lists(st.tuples(st.sampled_from(["ask", "decide", "answer", "give up", "look"]), st.integers(0, 5)), max_size=60)


class Town:
    """Clients and a log that is right, in small steps."""

    def __init__(self) -> None:
        self.history = LogHistory()
        self.log: list[bytes] = []
        self.open: list[Attempt] = []
        self.dead: set[bytes] = set()

    @property
    def at(self) -> dict[bytes, int]:
        return {request: position for position, request in enumerate(self.log, 1)}

    def play(self, steps: Sequence[tuple[str, int]]) -> Town:
        for step, number in steps:
            self._step(step, REQUESTS[number], number)
        return self

    def _step(self, step: str, request: bytes, number: int) -> None:
        if step == "ask" and request not in self.dead:
            self.open.append(self.history.asks(request, f"c{number}", 0.0))
        elif step == "decide" and request not in self.dead and request not in self.log:
            if any(attempt.request == request and attempt.told is Told.UNKNOWN for attempt in self.history.attempts):
                self.log.append(request)
        elif self.open and step in ("answer", "give up"):
            attempt = self.open.pop(number % len(self.open))
            position = self.at.get(attempt.request)
            told = Told.UNKNOWN if position is None or step == "give up" else Told.COMMITTED
            self.history.ends(attempt, told, position or 0)
        elif step == "look" and not any(attempt.request == request for attempt in self.open):
            # Whoever looks closes what was asked for, if it is not there.
            looking = self.history.asks(request, "looker", 0.0)
            if request in self.log:
                self.history.ends(looking, Told.COMMITTED, self.at[request])
            else:
                self.dead.add(request)
                self.history.ends(looking, Told.NEVER)


def laws_broken(town: Town, at: dict[bytes, int] | None = None) -> set[str]:
    return {wrong.law for wrong in wrong_answers(town.history.attempts, town.at if at is None else at)}


@given(STEPS)
def test_what_is_right_passes(steps: list[tuple[str, int]]) -> None:
    assert laws_broken(Town().play(steps)) == set()


@given(STEPS, st.integers(0, 100))
def test_an_acknowledged_entry_that_is_lost_or_moved_is_missed(steps: list[tuple[str, int]], which: int) -> None:
    town = Town().play([*steps, ("ask", 0), ("decide", 0), ("answer", 0)])
    acknowledged = sorted({attempt.request for attempt in town.history.attempts if attempt.told is Told.COMMITTED})
    if not acknowledged:
        return
    victim = acknowledged[which % len(acknowledged)]
    lost = {request: position for request, position in town.at.items() if request != victim}
    assert laws.ENTRIES_STAY in laws_broken(town, lost)
    assert laws.ENTRIES_STAY in laws_broken(town, {**town.at, victim: len(town.log) + 1})


@given(STEPS)
def test_what_was_denied_and_is_decided_is_noticed(steps: list[tuple[str, int]]) -> None:
    town = Town().play(steps)
    for request in town.dead:
        assert laws.REFUSED_STAYS_OUT in laws_broken(town, {**town.at, request: len(town.log) + 1})


@given(STEPS)
def test_what_is_decided_before_something_older_that_was_acknowledged_is_noticed(steps: list[tuple[str, int]]) -> None:
    town = Town().play(steps)
    last = bytes(16)
    town.history.ends(town.history.asks(last, "late", 1.0), Told.UNKNOWN)
    acknowledged = [attempt for attempt in town.history.attempts if attempt.told is Told.COMMITTED]
    at = {**town.at, last: 0}
    assert (laws.REAL_TIME in laws_broken(town, at)) == bool(acknowledged)


def told(*answers: tuple[str, Told, int]) -> LogHistory:
    """One after the other: what was asked for, and what was told."""
    history = LogHistory()
    for name, answer, position in answers:
        history.ends(history.asks(name.encode(), "c", 0.0), answer, position)
    return history


@pytest.mark.parametrize(
    ("answers", "at", "law"),
    [
        ([("a", Told.REFUSED, 0)], {"a": 1}, laws.REFUSED_STAYS_OUT),
        ([("a", Told.REFUSED, 0), ("a", Told.REFUSED, 0)], {"a": 1}, laws.REFUSED_STAYS_OUT),
        ([("a", Told.REFUSED, 0), ("a", Told.UNKNOWN, 0)], {"a": 1}, None),
        ([("a", Told.UNKNOWN, 0), ("a", Told.REFUSED, 0)], {"a": 1}, None),
        ([("a", Told.UNKNOWN, 0), ("a", Told.NEVER, 0)], {"a": 1}, laws.REFUSED_STAYS_OUT),
        ([("a", Told.NEVER, 0), ("a", Told.COMMITTED, 1)], {"a": 1}, None),
        ([("a", Told.COMMITTED, 1), ("b", Told.COMMITTED, 2)], {"a": 1, "b": 2}, None),
        ([("a", Told.COMMITTED, 2), ("b", Told.COMMITTED, 1)], {"a": 2, "b": 1}, laws.REAL_TIME),
        ([("a", Told.COMMITTED, 2), ("b", Told.UNKNOWN, 0)], {"a": 2, "b": 1}, laws.REAL_TIME),
        ([("a", Told.COMMITTED, 1)], {}, laws.ENTRIES_STAY),
        ([("a", Told.COMMITTED, 1)], {"a": 2}, laws.ENTRIES_STAY),
        ([("a", Told.UNKNOWN, 0)], {}, None),
    ],
)
def test_single_answers(answers: list[tuple[str, Told, int]], at: dict[str, int], law: str | None) -> None:
    found = wrong_answers(told(*answers).attempts, {name.encode(): position for name, position in at.items()})
    assert [wrong.law for wrong in found][:1] == ([] if law is None else [law])


def test_what_is_asked_beside_an_acknowledgement_may_lie_before_it() -> None:
    history = LogHistory()
    slow, quick = history.asks(b"slow", "c", 0.0), history.asks(b"quick", "d", 0.0)
    history.ends(quick, Told.COMMITTED, 2)
    history.ends(slow, Told.COMMITTED, 1)
    assert wrong_answers(history.attempts, {b"slow": 1, b"quick": 2}) == []


def test_a_look_beside_an_attempt_that_goes_on_says_nothing_about_it() -> None:
    history = LogHistory()
    trying = history.asks(b"a", "c", 0.0)
    history.ends(history.asks(b"a", "looker", 0.0), Told.NEVER)
    history.ends(trying, Told.COMMITTED, 1)
    assert wrong_answers(history.attempts, {b"a": 1}) == []


def test_the_best_word_about_a_request_counts() -> None:
    history = told(("a", Told.UNKNOWN, 0), ("a", Told.COMMITTED, 1), ("b", Told.UNKNOWN, 0), ("c", Told.UNKNOWN, 0), ("c", Told.NEVER, 0))
    assert history.outcomes() == {b"a": Told.COMMITTED, b"b": Told.UNKNOWN, b"c": Told.NEVER}
