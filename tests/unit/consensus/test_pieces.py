"""If one fails, a piece that the argument of specs/25-consensus.md stands on is not what it says: majorities, facts, the choice, routes, a step."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import combinations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Persist, Promise, Refusal, Send, Slot, Step, Value, Vote
from scenefold.consensus.ballots import COUNTER_MAX, NO_BALLOT, next_ballot
from scenefold.consensus.certificates import certificate_of
from scenefold.consensus.choosing import Choice, choose, highest_of
from scenefold.consensus.facts import Fact, is_true, merged, signed, true_facts
from scenefold.consensus.messages import AskLog
from scenefold.consensus.routes import arms, beyond, first_of, homeward, in_line, straight_to
from scenefold.consensus.timing import Timing
from scenefold.wire import Ballot, Phase, ProposalId
from unit.consensus.logs_made import GENESIS, key_of, member, participant, participants

BALLOTS = st.builds(Ballot, st.integers(1, 4), st.integers(1, 5).map(NodeId))
MEMBERS = st.builds(member, st.integers(1, 5), st.integers(0, 1))
DIGESTS = st.sampled_from([bytes([number]) * 32 for number in range(3)])
PROMISES = st.builds(Promise, st.integers(1, 3), BALLOTS, BALLOTS, DIGESTS, MEMBERS)
VOTES = st.builds(Vote, st.integers(1, 3), BALLOTS, DIGESTS, MEMBERS)
IDS = st.builds(ProposalId, st.integers(1, 3), BALLOTS, st.sampled_from(Phase))
REFUSALS = st.builds(Refusal, IDS, st.sampled_from(RejectReason), BALLOTS, MEMBERS)
KINDS: tuple[st.SearchStrategy[Any], ...] = (PROMISES, VOTES, REFUSALS)
FACTS: st.SearchStrategy[Any] = st.one_of(*KINDS)
TWO_OF_A_KIND = st.one_of(*(st.tuples(kind, kind) for kind in KINDS))


@given(st.integers(1, DECIDERS_MAX))
def test_any_two_majorities_meet(n: int) -> None:
    assert 2 * participants(*range(1, n + 1)).majority > n
    assert participants(*range(1, n + 1)).majority - 1 <= n / 2, "and no smaller number would do"


@pytest.mark.parametrize("nodes", [(), (1, 1), tuple(range(1, DECIDERS_MAX + 2))])
def test_nobody_decides_for_nobody(nodes: tuple[int, ...]) -> None:
    with pytest.raises(Refused):
        participants(*nodes)


def test_the_order_of_participants_means_nothing() -> None:
    assert participants(3, 1, 2) == participants(1, 2, 3)
    assert member(1, 7) not in participants(1, 2)
    with pytest.raises(Refused):
        participants(1, 2).joined_by(participant(member(2, 9)))
    with pytest.raises(Refused):
        participants(1, 2).left_by(member(2, 9))


@given(FACTS, FACTS)
def test_no_two_facts_are_signed_by_the_same_bytes(one: Any, other: Any) -> None:
    """Within a kind; and each kind has a domain of its own."""
    assert (one.DOMAIN, one.signable(GENESIS)) != (other.DOMAIN, other.signable(GENESIS)) or one == other
    assert one.signable(GENESIS) != one.signable(bytes(32))


@given(TWO_OF_A_KIND, st.data())
def test_a_changed_fact_is_none(facts: tuple[Any, Any], data: st.DataObject) -> None:
    fact, other = facts
    true = signed(fact, GENESIS, key_of(fact.member))
    everyone = participants(*range(1, 6))
    assert is_true(true, GENESIS, everyone) is (fact.member in everyone)
    name = data.draw(st.sampled_from([found.name for found in fields(fact)]))
    changed = replace(true, **{name: getattr(other, name)})
    assert changed == true or not is_true(changed, GENESIS, everyone)
    assert not is_true(true, bytes(32), everyone)


def promised(node: int, accepted: Ballot = NO_BALLOT, value: Value | None = None) -> Promise:
    return Promise(1, Ballot(9, NodeId(1)), accepted, bytes(32) if value is None else value.digest, member(node))


ONE, TWO, WISH = Value(b"one"), Value(b"two"), Value(b"wish")


def test_the_choice() -> None:
    three = participants(1, 2, 3)
    low, high = Ballot(1, NodeId(2)), Ballot(2, NodeId(1))
    assert choose((promised(1),), (), WISH, three) is None, "too few"
    assert choose((promised(1), promised(2)), (ONE,), WISH, three) == Choice(WISH)
    assert choose((promised(1), promised(2)), (), None, three) == Choice(None)
    both = (promised(1, low, ONE), promised(2, high, TWO))
    assert choose(both, (ONE, TWO), WISH, three) == Choice(TWO)
    assert choose(both, (TWO,), WISH, three) == Choice(TWO), "the bytes of the lower one are not needed"
    assert choose(both, (ONE,), WISH, three) is None, "those of the highest are"
    assert choose((*both, promised(3)), (ONE,), WISH, three) == Choice(ONE), "or there is a majority without whoever names it"
    assert highest_of(both, (ONE, TWO)) == TWO and highest_of(both, (WISH,)) is None


@given(st.lists(st.tuples(st.integers(1, 5), BALLOTS | st.just(NO_BALLOT), st.sampled_from([ONE, TWO])), max_size=5), st.data())
def test_a_chosen_value_is_always_chosen_again(claims: list[tuple[int, Ballot, Value]], data: st.DataObject) -> None:
    """Whatever a majority has voted for in a ballot is the choice of whoever hears a majority, if all later votes are for it."""
    everyone = participants(*range(1, 6))
    chosen_in = data.draw(BALLOTS)
    majority = data.draw(st.sampled_from(list(combinations(range(1, 6), 3))))
    values: dict[int, tuple[Ballot, Value | None]] = {}
    for node, ballot, value in claims:
        values[node] = (ballot, None if ballot == NO_BALLOT else ONE if ballot >= chosen_in else value)
    for node in majority:
        if values.get(node, (NO_BALLOT, None))[0] < chosen_in:
            values[node] = (chosen_in, ONE)
    heard = data.draw(st.sampled_from(list(combinations(range(1, 6), 3))))
    facts = [promised(node, *values.get(node, (NO_BALLOT, None))) for node in heard]
    assert choose(facts, (ONE, TWO), WISH, everyone) == Choice(ONE)


@given(st.permutations([vote for node in (1, 2, 3) for vote in (Vote(1, Ballot(1, NodeId(1)), ONE.digest, member(node)),)] * 2))
def test_votes_count_once_in_any_order(votes: list[Vote]) -> None:
    certificate = certificate_of(1, Ballot(1, NodeId(1)), ONE.digest, votes, participants(1, 2, 3, 4, 5))
    assert certificate is not None and len(certificate.votes) == 3
    assert certificate_of(1, Ballot(2, NodeId(1)), ONE.digest, votes, participants(1, 2, 3, 4, 5)) is None


@given(st.lists(PROMISES | VOTES), IDS, DIGESTS)
def test_only_facts_of_the_ballot_and_value_are_collected(facts: list[Fact], proposal: ProposalId, digest: bytes) -> None:
    everyone = participants(*range(1, 6))
    true: list[Any] = [signed(fact, GENESIS, key_of(fact.member)) for fact in facts]  # type: ignore[type-var]
    kept = merged(true_facts(true, proposal, digest, GENESIS, everyone))
    assert len({fact.member for fact in kept}) == len(kept)
    for fact in kept:
        assert (fact.position, fact.ballot) == (proposal.position, proposal.ballot) and fact.member in everyone
        assert isinstance(fact, Promise) is (proposal.phase is Phase.PREPARE)
        assert isinstance(fact, Promise) or fact.digest == digest


@given(st.lists(BALLOTS, max_size=4), st.integers(1, 5).map(NodeId))
def test_the_next_ballot_is_above_all(met: list[Ballot], node: NodeId) -> None:
    ballot = next_ballot(node, met)
    assert ballot is not None and ballot.node == node and all(ballot > other for other in met)
    assert next_ballot(node, [Ballot(COUNTER_MAX, node)]) is None


@given(st.permutations(range(1, 8)), st.integers(1, 7), st.integers(1, 7))
def test_an_arm_visits_everybody_and_leads_home(order: list[int], origin: int, at: int) -> None:
    route = tuple(NodeId(node) for node in order)
    left, right = arms(route, NodeId(origin))
    assert sorted((*left, *right, origin)) == sorted(route)
    further, home = beyond(route, NodeId(origin), NodeId(at)), homeward(route, NodeId(origin), NodeId(at))
    assert home[-1] == origin
    if at != origin:
        assert (*home[:-1][::-1], NodeId(at), *further) in (left, right)
    straight = straight_to(route, NodeId(origin), NodeId(at))
    if at != origin:
        assert sorted(straight) == sorted(route) and beyond(straight, NodeId(origin), NodeId(at)) == ()


def test_who_is_on_no_route_hands_nothing_on() -> None:
    route = (NodeId(1), NodeId(2))
    assert beyond(route, NodeId(1), NodeId(9)) == () == beyond(route, NodeId(9), NodeId(1))
    assert homeward(route, NodeId(1), NodeId(9)) == (1,)
    assert in_line((NodeId(3), NodeId(1), NodeId(2)), (NodeId(2), NodeId(1))) == (2, 1, 3)
    assert first_of(route, frozenset((NodeId(2),))) == 2 and first_of(route, frozenset()) is None


def test_a_step_writes_first_and_once() -> None:
    """Rule D is the shape of a step."""
    write, send = Persist(Slot()), Send(NodeId(1), AskLog(GENESIS, 0))
    assert Step(None, (write, send)).write == write and Step(None, (send,)).write is None and Step(None, ()).write is None
    for wrong in ((send, write), (write, write)):
        with pytest.raises(AssertionError):
            Step(None, wrong)


def test_a_promise_is_kept_and_a_ballot_has_one_value() -> None:
    slot = Slot().promise(Ballot(2, NodeId(1))).vote(Ballot(2, NodeId(1)), ONE)
    assert slot.vote(Ballot(2, NodeId(1)), ONE) == slot
    for broken in (lambda: slot.promise(Ballot(1, NodeId(9))), lambda: slot.vote(Ballot(2, NodeId(1)), TWO)):
        with pytest.raises(AssertionError):
            broken()


def test_pauses_grow_and_end_growing() -> None:
    timing = Timing()
    assert [timing.rest_s(tries)[1] for tries in (1, 2, 6, 7, 99)] == pytest.approx([0.2, 0.4, 6.4, 6.4, 6.4])
    assert timing.pass_s(1) == timing.pass_s_min and timing.pass_s(10) == pytest.approx(3.3)
    assert timing.orphan_s(5, 1)[0] == pytest.approx(timing.orphan_s(5, 0)[1])
