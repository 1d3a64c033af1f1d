"""If one fails, packets that are forged, edited, of other logs, or nonsense change what a node has promised or voted for (design §14, 15 and 20).

Keys are real ones here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import pytest

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import (
    Ask,
    Certificate,
    Learn,
    Message,
    Participant,
    Participants,
    Persist,
    Promise,
    Propose,
    Received,
    Refusal,
    Rejected,
    Send,
    Setting,
    Stage,
    State,
    Value,
    View,
    Vote,
    take,
)
from scenefold.consensus.effects import Decide, Step
from scenefold.consensus.facts import signed
from scenefold.crypto import SigningKey
from scenefold.wire import Ballot, Phase, ProposalId
from unit.consensus.logs_made import GENESIS, Book, member

A, B, C = (NodeId(number) for number in (1, 2, 3))
BALLOT = Ballot(1, A)


@lru_cache(None)
def key(node: int) -> SigningKey:
    return SigningKey.from_seed(bytes([node]) * 32)


EVERYONE = Participants(tuple(Participant(member(node), key(node).public) for node in (A, B, C)))
BOOK = Book(EVERYONE)
VALUE = BOOK.value("it", A)
VIEW = View(0.0, (A, B, C), frozenset((A, B, C)), frozenset((A, B, C)))


def promise(node: int, ballot: Ballot = BALLOT) -> Promise:
    return signed(Promise(1, ballot, Ballot(0, NodeId(0)), bytes(32), member(node)), GENESIS, key(node))


def vote(node: int, value: Value = VALUE, ballot: Ballot = BALLOT) -> Vote:
    return signed(Vote(1, ballot, value.digest, member(node)), GENESIS, key(node))


def proposal(phase: Phase, ballot: Ballot = BALLOT) -> Propose:
    fact = promise(ballot.node, ballot) if phase is Phase.PREPARE else vote(ballot.node, ballot=ballot)
    return Propose(GENESIS, ProposalId(1, ballot, phase), (A, B, C), (fact,), value=VALUE)


def at_b(message: Message, state: State | None = None) -> Step[State]:
    return take(Setting(GENESIS, member(B), key(B)), state or State(BOOK), Received(A, message), VIEW)


def refusals(step: Step[State]) -> list[RejectReason]:
    sent = [effect.message for effect in step.effects if isinstance(effect, Send)]
    return [message.refusal.reason for message in sent if isinstance(message, Rejected)]


FORGED: dict[str, tuple[Callable[[Propose], Propose], RejectReason | None]] = {
    "another log under the same id": (lambda it: replace(it, genesis=bytes(32)), None),
    "nothing in it": (lambda it: replace(it, value=None), None),
    "no fact of its originator": (lambda it: replace(it, facts=()), RejectReason.SIGNATURE_INVALID),
    "a fact that somebody else signed": (
        lambda it: replace(it, facts=(replace(it.facts[0], signature=bytes(64)),)),
        RejectReason.SIGNATURE_INVALID,
    ),
    "a higher ballot, by whoever carries it": (
        lambda it: replace(it, proposal=replace(it.proposal, ballot=Ballot(2**32 - 1, A))),
        RejectReason.SIGNATURE_INVALID,
    ),
    "another position": (lambda it: replace(it, proposal=replace(it.proposal, position=2)), None),
    "another value": (lambda it: replace(it, value=BOOK.value("other", A)), RejectReason.SIGNATURE_INVALID),
    "a bit of the value": (lambda it: replace(it, value=Value(VALUE.data[:-1] + b"}")), RejectReason.SIGNATURE_INVALID),
    "the other phase": (lambda it: replace(it, proposal=replace(it.proposal, phase=Phase.PREPARE)), RejectReason.SIGNATURE_INVALID),
    "a short route": (lambda it: replace(it, route=(A, B)), RejectReason.PEER_MISSED),
    "another incarnation": (
        lambda it: replace(it, facts=(signed(replace(vote(A), member=member(A, 7)), GENESIS, key(A)),)),
        RejectReason.NOT_AUTHORISED,
    ),
    "a first ballot, by one who is not the first": (
        lambda it: replace(it, proposal=replace(it.proposal, ballot=Ballot(0, A)), facts=(vote(A, ballot=Ballot(0, A)),)),
        RejectReason.NOT_AUTHORISED,
    ),
    "a stranger": (
        lambda it: replace(it, proposal=replace(it.proposal, ballot=Ballot(1, NodeId(9)))),
        RejectReason.NOT_AUTHORISED,
    ),
}


@pytest.mark.parametrize("what", FORGED)
def test_15_20_a_vote_is_for_what_its_originator_has_signed(what: str) -> None:
    edit, reason = FORGED[what]
    assert isinstance(at_b(proposal(Phase.ACCEPT)).write, Decide | Persist)
    step = at_b(edit(proposal(Phase.ACCEPT)))
    assert step.write is None
    assert refusals(step) == ([] if reason is None else [reason])


def test_20_what_nobody_does_by_himself() -> None:
    """Its own proposal comes back to a node; a participant proposes what the judge refuses."""
    own = proposal(Phase.ACCEPT, Ballot(1, B))
    assert at_b(own).effects == ()
    wrong = Value(b'[7, "", "it", 1, null]')
    for message in (
        replace(proposal(Phase.PREPARE), value=wrong),
        replace(proposal(Phase.ACCEPT), value=wrong, facts=(vote(A, wrong),)),
    ):
        assert at_b(message).write is None and refusals(at_b(message)) == [RejectReason.ILL_FORMED]


def test_20_facts_that_are_not_true_are_left_out() -> None:
    """They do no harm to those that are."""
    forged = replace(promise(C), signature=bytes(64))
    step = at_b(replace(proposal(Phase.PREPARE), facts=(promise(A), forged)))
    [handed_on] = [effect.message for effect in step.effects if isinstance(effect, Send)]
    assert isinstance(handed_on, Propose)
    assert handed_on.facts == (promise(A), promise(B))


def test_20_two_votes_are_a_decision_only_if_they_are_true_and_two() -> None:
    def learnt(*votes: Vote, position: int = 1, value: Value = VALUE) -> bool:
        return at_b(Learn(GENESIS, 1, value, Certificate(position, BALLOT, votes))).write is not None

    assert learnt(vote(A), vote(C))
    assert learnt(vote(A), vote(A), vote(C))
    assert not learnt(vote(A), vote(A))
    assert not learnt(vote(A))
    assert not learnt(vote(A), replace(vote(C), signature=bytes(64)))
    assert not learnt(vote(A), vote(C, ballot=Ballot(2, A))), "of two ballots"
    assert not learnt(vote(A), vote(C), position=2)
    assert not learnt(vote(A), vote(C), value=BOOK.value("other", A))
    assert not learnt(vote(A), signed(Vote(1, BALLOT, VALUE.digest, member(9)), GENESIS, key(9)))
    assert at_b(Learn(bytes(32), 1, VALUE, Certificate(1, BALLOT, (vote(A), vote(C))))).write is None


def test_20_nobody_but_a_participant_ends_a_proposal_or_drives_its_ballots() -> None:
    """A refusal that is not signed closes its arm, and says nothing."""
    setting = Setting(GENESIS, member(A), key(A))
    asked = take(setting, State(BOOK), Ask(VALUE, 30.0), VIEW)
    current = asked.after.proposal.id
    assert current is not None
    plain = Refusal(current, RejectReason.ILL_FORMED, Ballot(2**32 - 1, C), member(C))

    def after(refusal: Refusal) -> State:
        message = Rejected(GENESIS, current, bytes(32), refusal)
        return take(setting, asked.after, Received(B, message), VIEW).after

    for forged in (plain, signed(plain, GENESIS, key(B)), signed(plain, bytes(32), key(C))):
        assert after(forged).proposal.stage is Stage.SEEKING
        assert after(forged).proposal.met is None
    assert after(signed(plain, GENESIS, key(C))).proposal.stage is Stage.IDLE, "a true one does"


def test_20_a_value_that_its_promise_does_not_name_is_not_taken_over() -> None:
    """`highest` is bytes: what they are worth says the promise that names them."""
    step = at_b(replace(proposal(Phase.PREPARE), highest=BOOK.value("slipped in", A)))
    [handed_on] = [effect.message for effect in step.effects if isinstance(effect, Send)]
    assert isinstance(handed_on, Propose) and handed_on.highest is None
