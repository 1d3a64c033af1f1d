"""If one fails, a node is removed without the word of a voter that might have heard it, or a voter that can write nothing keeps all from being removed."""

from __future__ import annotations

from scenefold.peer.cluster_log.missed import MISSED_AGAIN_S, MISSED_S, Missed
from unit.peer.logs_made import member, node


def test_whoever_says_nothing_for_long_is_passed_over() -> None:
    missed = Missed()
    missed.note(member(4), node(1), 100.0)
    missed.note(member(4), node(1), 110.0)
    assert not missed.is_for_long(member(4), 100.0 + MISSED_S - 0.1)
    assert missed.is_for_long(member(4), 100.0 + MISSED_S)


def test_what_was_missed_long_ago_counts_no_more() -> None:
    missed = Missed()
    missed.note(member(4), node(1), 100.0)
    later = 100.0 + MISSED_AGAIN_S + 0.1
    assert not missed.is_for_long(member(4), later)
    missed.note(member(4), node(1), later)
    assert not missed.is_for_long(member(4), later + MISSED_S - 0.1)
    assert missed.is_for_long(member(4), later + MISSED_S)


def test_another_voter_s_silence_is_another_one() -> None:
    missed = Missed()
    missed.note(member(4), node(1), 100.0)
    missed.note(member(4), node(2), 129.0)
    assert not missed.is_for_long(member(4), 100.0 + MISSED_S)
    assert missed.is_for_long(member(4), 129.0 + MISSED_S)


def test_another_incarnation_s_removal_is_another_one() -> None:
    missed = Missed()
    missed.note(member(4), node(1), 100.0)
    assert not missed.is_for_long(member(4, 1), 100.0 + MISSED_S)


def test_an_attempt_that_nobody_was_missed_at_ends_it() -> None:
    missed = Missed()
    missed.note(member(4), node(1), 100.0)
    missed.clear(member(4))
    assert not missed.is_for_long(member(4), 100.0 + MISSED_S)
