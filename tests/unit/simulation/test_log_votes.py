"""If this fails, a participant may forget what it has promised or voted for, or a certificate name whom it likes, and nobody notices."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.simulation import laws
from scenefold.simulation.log_history import Wrong
from scenefold.simulation.log_votes import Paper, Voting
from scenefold.wire import Ballot, Member

NODES = [Member(NodeId(number), bytes([number]) * 16) for number in range(1, 8)]
A, B = b"a" * 32, b"b" * 32


def ballot(counter: int, node: int = 1) -> Ballot:
    return Ballot(counter, NodeId(node))


def voting(count: int, positions: int = 1) -> Voting:
    found = Voting()
    for position in range(1, positions + 1):
        assert found.decides(position, frozenset(NODES[:count])) == []
    return found


def broken(wrong: list[Wrong]) -> list[str]:
    return [one.law for one in wrong]


@given(st.sampled_from([1, 3, 4, 5, 7]), st.integers(1, 6), st.randoms(use_true_random=False))
def test_what_a_majority_does_right_passes(count: int, positions: int, dice: random.Random) -> None:
    """Promises, votes, perhaps of one alone at first, and a certificate, by whoever casts the last vote."""
    votes, members = voting(count, positions), NODES[:count]
    for position in range(1, positions + 1):
        some, value = dice.sample(members, count // 2 + 1), dice.choice([A, B])
        accepted: tuple[Ballot, bytes] | None = None
        for counter in range(1, dice.randint(1, 3)):
            number = ballot(counter, dice.choice(members).node)
            for member in some:
                assert votes.wrote(member, Paper(position, number, accepted if member == some[0] else None)) == []
            accepted = number, value
            assert votes.wrote(some[0], Paper(position, number, accepted)) == []
        last = ballot(4, dice.choice(members).node)
        for member in some[:-1]:
            assert votes.wrote(member, Paper(position, last, (last, value))) == []
        assert votes.certified(some[-1], position, last, value, some) == []
        assert votes.chosen[position] == value


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (Paper(1, ballot(3)), Paper(1, ballot(2))),
        (Paper(1, ballot(3, 2)), Paper(1, ballot(3, 1))),
        (Paper(1, ballot(3), (ballot(3), A)), Paper(1, ballot(3))),
        (Paper(1, ballot(3), (ballot(3), A)), Paper(1, ballot(4), (ballot(2), B))),
        (Paper(1, ballot(3), (ballot(3), A)), Paper(1, ballot(3), (ballot(3), B))),
        (Paper(2, ballot(1)), Paper(1, ballot(9))),
    ],
)
def test_what_is_promised_and_voted_for_stays(before: Paper, after: Paper) -> None:
    votes = voting(3, 2)
    assert votes.wrote(NODES[0], before) == [] == votes.wrote(NODES[0], before)
    assert laws.PROMISES in broken(votes.wrote(NODES[0], after))


def test_a_new_incarnation_and_a_new_position_begin_anew() -> None:
    votes = voting(3, 2)
    votes.wrote(NODES[0], Paper(1, ballot(3), (ballot(3), A)))
    assert votes.wrote(NODES[0], Paper(2, ballot(0, 0))) == []
    assert votes.wrote(Member(NODES[0].node, b"n" * 16), Paper(1, ballot(1))) == []


def test_a_ballot_has_one_value_whoever_votes_for_it() -> None:
    votes = voting(3)
    votes.wrote(NODES[0], Paper(1, ballot(1), (ballot(1), A)))
    assert laws.PROMISES in broken(votes.wrote(NODES[1], Paper(1, ballot(1), (ballot(1), B))))


def test_a_certificate_names_votes_that_are_on_disks_but_its_own() -> None:
    votes = voting(3)
    assert laws.CERTIFIED in broken(votes.certified(NODES[0], 1, ballot(1), A, NODES[:2]))
    votes = voting(3)
    votes.wrote(NODES[1], Paper(1, ballot(1), (ballot(1), A)))
    assert votes.certified(NODES[0], 1, ballot(1), A, NODES[:2]) == []
    assert votes.certified(NODES[2], 1, ballot(1), A, NODES[:2]) == [], "whoever learns it later has voted for nothing"


def test_votes_of_several_ballots_are_no_majority() -> None:
    votes = voting(5)
    for number, member in enumerate(NODES[:3], 1):
        votes.wrote(member, Paper(1, ballot(number), (ballot(number), A)))
    assert not votes.chosen
    assert laws.CERTIFIED in broken(votes.certified(NODES[0], 1, ballot(3), A, NODES[2:3]))


def test_half_is_no_majority_and_two_values_are_never_chosen() -> None:
    votes = voting(4)
    for member in NODES[:2]:
        votes.wrote(member, Paper(1, ballot(1), (ballot(1), A)))
    assert laws.CERTIFIED in broken(votes.certified(NODES[0], 1, ballot(1), A, NODES[:2]))
    for member in NODES[:3]:
        votes.wrote(member, Paper(1, ballot(2), (ballot(2), A)))
    assert votes.chosen[1] == A
    wrong = [one for member in NODES[1:4] for one in votes.wrote(member, Paper(1, ballot(3), (ballot(3), B)))]
    assert broken(wrong) == [laws.ONE_VALUE]


def test_who_takes_no_part_does_not_vote() -> None:
    votes = voting(3)
    assert broken(votes.wrote(NODES[3], Paper(1, ballot(1), (ballot(1), A)))) == [laws.CERTIFIED]
    assert broken(votes.decides(1, frozenset(NODES[:4]))) == [laws.ONE_VALUE] and votes.decides(1, frozenset(NODES[:3])) == []


def test_what_another_one_brings_to_an_end_is_taken_over() -> None:
    votes = voting(3, 2)
    votes.wrote(NODES[0], Paper(1, ballot(1, 1), (ballot(1, 1), A)))
    votes.wrote(NODES[1], Paper(1, ballot(2, 2), (ballot(2, 2), A)))
    assert votes.certified(NODES[2], 1, ballot(2, 2), A, NODES[1:3]) == [] and votes.taken_over == 1
    votes.wrote(NODES[0], Paper(2, ballot(1, 1), (ballot(1, 1), A)))
    assert votes.certified(NODES[1], 2, ballot(1, 1), A, NODES[:2]) == [] and votes.taken_over == 1
