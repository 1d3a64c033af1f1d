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
    AskLog,
    Certificate,
    Learn,
    Lost,
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
    SetTimer,
    Setting,
    Stage,
    State,
    Tell,
    Value,
    View,
    Vote,
    take,
)
from scenefold.consensus.effects import Decide, Step
from scenefold.consensus.facts import signed
from scenefold.consensus.messages import Accepted
from scenefold.consensus.timing import Timer, Waits
from scenefold.consensus.values import NO_DIGEST
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


FIVE = tuple(map(NodeId, range(1, 6)))
LARGE = Book(Participants(tuple(Participant(member(node), key(node).public) for node in FIVE)))
WIDE_VIEW = View(0.0, FIVE, frozenset(FIVE), frozenset(FIVE))
STRANGER = NodeId(9)
"""A node that takes no part, and lives."""


def heard(message: Message, sender: NodeId, state: State | None = None, now: float = 0.0, me: int = B) -> Step[State]:
    return take(Setting(GENESIS, member(me), key(me)), state or State(BOOK), Received(sender, message), replace(VIEW, now=now))


def decided() -> State:
    """B, which knows position 1."""
    return at_b(Learn(GENESIS, 1, VALUE, Certificate(1, BALLOT, (vote(A), vote(C))))).after


def test_20_nobody_is_told_a_log_because_somebody_else_names_it() -> None:
    """What is decided is megabytes: whoever brings an old proposal gets it, and whom its ballot names only if it takes part."""
    made_up = replace(proposal(Phase.ACCEPT), proposal=ProposalId(1, Ballot(1, NodeId(77)), Phase.ACCEPT))
    assert [effect.target for effect in heard(made_up, STRANGER, decided()).effects if isinstance(effect, Tell)] == [STRANGER]
    told = [effect.target for effect in heard(proposal(Phase.ACCEPT), C, decided()).effects if isinstance(effect, Tell)]
    assert told == [C, A]


@pytest.mark.parametrize("me, position", [(B, 5), (STRANGER, 1)], ids=["too far ahead", "takes no part"])
def test_20_nobody_carries_what_a_stranger_brings(me: int, position: int) -> None:
    """None of it can be looked at: it may be megabytes of nothing, for anybody, and would be kept until it has come home."""
    plain = proposal(Phase.ACCEPT)
    ahead = replace(plain, proposal=replace(plain.proposal, position=position), route=(A, NodeId(me), C))
    stranger = STRANGER if me == B else NodeId(8)
    step = heard(ahead, stranger, me=me)
    # It may be that this node is behind, and the other one new; he need not wait.
    home = [(effect.target, effect.message) for effect in step.effects if isinstance(effect, Send) and isinstance(effect.message, Accepted)]
    answer = Accepted(GENESIS, ahead.proposal, ahead.digest, ahead.facts)
    assert home == ([(stranger, answer)] if position == 5 else [])
    assert not step.after.hops and not [
        effect for effect in step.effects if isinstance(effect, Send) and isinstance(effect.message, Propose)
    ]
    # What a participant brings is handed on, as it always was.
    carried = heard(ahead, A, me=me)
    assert [effect.target for effect in carried.effects if isinstance(effect, Send) and isinstance(effect.message, Propose)] == [C]
    assert len(carried.after.hops) == 1


def test_20_a_stranger_cannot_have_a_proposal_promised() -> None:
    """What is asked for is none of what its originator has signed, and only participants are trusted to bring that: it may not suit this node."""
    assert heard(proposal(Phase.PREPARE), STRANGER).effects == ()
    assert isinstance(heard(proposal(Phase.PREPARE), C).write, Persist)


def test_20_a_stranger_keeps_nobody_from_asking_a_participant() -> None:
    ahead = Learn(GENESIS, 9, VALUE, Certificate(9, BALLOT, ()))

    def asked(step: Step[State]) -> list[NodeId]:
        return [effect.target for effect in step.effects if isinstance(effect, Send) and isinstance(effect.message, AskLog)]

    first = heard(ahead, STRANGER)
    assert asked(first) == [STRANGER]
    assert asked(heard(ahead, NodeId(8), first.after, 0.5)) == [], "one of them, once in a while"
    second = heard(ahead, C, first.after, 0.1)
    assert asked(second) == [C]
    assert asked(heard(ahead, A, second.after, 0.2)) == []


def test_20_whoever_has_kept_a_packet_holds_no_takeover_up() -> None:
    """B has voted, and heard of it a while ago: the same ACCEPT once more is news only from one who takes part."""
    value = LARGE.value("it", A)
    message = replace(proposal(Phase.ACCEPT), route=WIDE_VIEW.line, facts=(vote(A, value),), value=value)
    setting = Setting(GENESIS, member(B), key(B))
    voted = take(setting, State(LARGE), Received(A, message), WIDE_VIEW).after
    lost = take(setting, voted, Lost(A), WIDE_VIEW).after
    assert voted.heard_at == 0.0 and lost.orphaned == BALLOT
    again = take(setting, lost, Received(STRANGER, message), replace(WIDE_VIEW, now=5.0))
    assert again.after.heard_at == 0.0 and again.after.orphaned == BALLOT
    assert not any(isinstance(effect, SetTimer) and effect.timer == Timer(Waits.ORPHAN) for effect in again.effects)
    from_one = take(setting, lost, Received(C, message), replace(WIDE_VIEW, now=5.0))
    assert from_one.after.heard_at == 5.0 and from_one.after.orphaned is None


def test_20_bytes_that_no_promise_names_are_not_kept() -> None:
    setting = Setting(GENESIS, member(A), key(A))
    asked = take(setting, State(LARGE), Ask(LARGE.value("it", A), 30.0), WIDE_VIEW).after
    current, other = asked.proposal.id, LARGE.value("voted for before", C)
    assert current is not None
    named = signed(Promise(1, current.ballot, Ballot(1, NodeId(0)), other.digest, member(C)), GENESIS, key(C))

    def kept(fact: Promise) -> tuple[Value, ...]:
        answer = Accepted(GENESIS, current, NO_DIGEST, (fact,), other)
        return take(setting, asked, Received(C, answer), WIDE_VIEW).after.proposal.values

    assert kept(promise(C, current.ballot)) == ()
    assert kept(named) == (other,)


def test_20_values_of_what_is_decided_are_not_kept_for_the_way_home() -> None:
    value = LARGE.value("it", A)
    message = replace(proposal(Phase.ACCEPT), route=WIDE_VIEW.line, facts=(vote(A, value),), value=value)
    setting = Setting(GENESIS, member(B), key(B))
    carried = take(setting, State(LARGE), Received(A, message), WIDE_VIEW).after
    assert carried.hops[0].value == value
    learn = Learn(GENESIS, 1, value, Certificate(1, BALLOT, (vote(A, value), vote(C, value), vote(4, value))))
    after = take(setting, carried, Received(C, learn), WIDE_VIEW).after
    assert after.position == 1 and [hop.value for hop in after.hops] == [None]


def test_20_nor_by_the_node_whose_vote_decides() -> None:
    message = replace(proposal(Phase.ACCEPT), facts=(vote(A),))
    step = heard(message, A)
    assert step.after.position == 1 and [hop.value for hop in step.after.hops] == [None]


@pytest.mark.parametrize("position", [1, 5], ids=["open", "too far ahead"])
def test_20_nobody_sends_home_what_a_stranger_brings(position: int) -> None:
    """It would go to whomever the ballot names, with megabytes that nobody has looked at."""
    asked = ProposalId(position, Ballot(1, NodeId(0x08080808)), Phase.PREPARE)
    named = Promise(position, asked.ballot, BALLOT, VALUE.digest, member(STRANGER), bytes(64))
    brought = Accepted(GENESIS, asked, NO_DIGEST, (named,), VALUE)
    assert heard(brought, STRANGER).effects == ()
    assert [effect.target for effect in heard(brought, C).effects if isinstance(effect, Send)] == [asked.ballot.node]


def test_20_a_stranger_closes_no_hop() -> None:
    """B waits for what C has to say to A's proposal; somebody else says that it is nothing."""
    message = replace(proposal(Phase.PREPARE), route=(A, B, C))
    waiting = heard(message, A).after
    assert [hop.is_waiting for hop in waiting.hops] == [True]
    nothing = Accepted(GENESIS, message.proposal, message.digest, ())
    stranger = heard(nothing, STRANGER, waiting)
    assert stranger.effects == () and stranger.after.hops == waiting.hops
    answered = heard(nothing, C, waiting)
    assert [effect.target for effect in answered.effects if isinstance(effect, Send)] == [A]
    assert [hop.is_waiting for hop in answered.after.hops] == [False]


def test_20_what_a_stranger_has_the_log_asked_for_is_asked_of_himself() -> None:
    """He may name anybody in a ballot."""
    ahead = replace(proposal(Phase.PREPARE), proposal=ProposalId(5, Ballot(1, NodeId(0x08080808)), Phase.PREPARE))
    asked = [effect.target for effect in heard(ahead, STRANGER).effects if isinstance(effect, Send) and isinstance(effect.message, AskLog)]
    assert asked == [STRANGER]


def test_20_who_has_something_against_it_says_so_unless_a_fact_names_what_was_begun() -> None:
    """Also where the bytes of that are missing: who proposes it may have nothing else to propose."""
    busy = replace(VIEW, veto=RejectReason.BUSY)
    setting = Setting(GENESIS, member(B), key(B))
    begun = signed(Promise(1, BALLOT, Ballot(0, C), VALUE.digest, member(A)), GENESIS, key(A))
    for facts, refused in ((proposal(Phase.PREPARE).facts, True), ((begun,), False)):
        message = replace(proposal(Phase.PREPARE), facts=facts)
        step = take(setting, State(BOOK), Received(A, message), busy)
        assert (step.write is None) is refused
