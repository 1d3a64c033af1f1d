"""If one fails, a node keeps or proposes what a value's digest holds at second hand as somebody on the way has changed it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from scenefold.base.reasons import RejectReason
from scenefold.consensus import (
    Accepted,
    Ask,
    AskLog,
    Certificate,
    Decide,
    Learn,
    Propose,
    Received,
    Send,
    Setting,
    State,
    Step,
    Value,
    View,
    take,
)
from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.facts import signed
from scenefold.wire import Ballot, Phase, Promise, ProposalId, Vote
from unit.consensus.logs_made import GENESIS, Book, key_of, member, participants

A, B, C, D, E = range(1, 6)
LINE = tuple(member(number).node for number in (A, B, C, D, E))
VIEW = View(0.0, LINE, frozenset(LINE), frozenset(LINE))
GOOD, BAD = b"the body", b"a body"


@dataclass(frozen=True)
class Bodies(Book):
    """A judge whose values all have the same body."""

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        if value.body != GOOD and not (is_decided and not value.body):
            return RejectReason.ILL_FORMED
        return super().refuses(value, is_decided=is_decided)


BOOK = Bodies(participants(A, B, C, D, E))
VALUE = replace(BOOK.value("it", A), body=GOOD)
BENT = replace(VALUE, body=BAD)
BALLOT = Ballot(1, LINE[0])


def at(number: int, state: State, event: Received | Ask, now: float = 0.0) -> Step[State]:
    return take(Setting(GENESIS, member(number), key_of(member(number))), state, event, replace(VIEW, now=now))


def vote(number: int) -> Vote:
    return signed(Vote(1, BALLOT, VALUE.digest, member(number)), GENESIS, key_of(member(number)))


def accept(value: Value, *voters: int) -> Propose:
    return Propose(GENESIS, ProposalId(1, BALLOT, Phase.ACCEPT), LINE, tuple(map(vote, voters)), value=value)


def decided(step: Step[State]) -> list[Value]:
    return [effect.value for effect in step.effects if isinstance(effect, Decide)]


def test_two_values_with_one_data_are_one() -> None:
    assert VALUE == BENT and VALUE.digest == BENT.digest and VALUE.body != BENT.body


def test_nobody_votes_for_a_value_whose_body_was_changed() -> None:
    assert at(B, State(BOOK), Received(LINE[0], accept(BENT, A))).write is None
    assert at(B, State(BOOK), Received(LINE[0], accept(VALUE, A))).write is not None


def test_who_handed_a_changed_body_on_decides_by_another_one() -> None:
    """A stranger to the log relays: it judges nothing, and sees the votes come home."""
    answer = Accepted(GENESIS, ProposalId(1, BALLOT, Phase.ACCEPT), VALUE.digest, (vote(A), vote(D), vote(E)))
    for value, expected in ((VALUE, [VALUE]), (BENT, [])):
        book = Bodies(participants(A, C, D, E))
        state = at(B, State(book), Received(LINE[0], accept(value, A))).after
        step = at(B, state, Received(LINE[2], answer))
        assert decided(step) == expected
        if expected:
            assert decided(step)[0].body == GOOD


def test_what_is_learnt_has_its_body_or_none() -> None:
    certificate = Certificate(1, BALLOT, (vote(A), vote(B), vote(C)))

    def learnt(value: Value) -> list[Value]:
        return decided(at(E, State(BOOK), Received(LINE[0], Learn(GENESIS, 1, value, certificate))))

    assert learnt(BENT) == []
    assert learnt(VALUE) == learnt(replace(VALUE, body=b"")) == [VALUE]


def test_who_has_voted_keeps_its_own_bytes_whatever_it_is_told() -> None:
    """Else whoever tells all of them the data alone makes them forget what they were trusted with, and nobody has it any more."""
    voted = at(B, State(BOOK), Received(LINE[0], accept(VALUE, A))).after
    certificate = Certificate(1, BALLOT, (vote(A), vote(B), vote(C)))
    lean = replace(VALUE, body=b"")
    assert [value.body for value in decided(at(B, voted, Received(LINE[4], Learn(GENESIS, 1, lean, certificate))))] == [GOOD]
    unvoted = at(E, State(BOOK), Received(LINE[4], Learn(GENESIS, 1, lean, certificate)))
    assert [value.body for value in decided(unvoted)] == [b""]


@dataclass(frozen=True)
class Whole(Book):
    """A judge that takes no value without its body, be it decided."""

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        return super().refuses(value, is_decided=is_decided) if value.body == GOOD else RejectReason.ILL_FORMED


def test_who_lacks_the_body_of_what_is_decided_asks_for_it() -> None:
    """It was told what those are told who have voted, and has forgotten that it has."""
    book = Whole(participants(A, B, C, D, E))
    lean, certificate = replace(VALUE, body=b""), Certificate(1, BALLOT, (vote(A), vote(B), vote(C)))
    step = at(B, State(book), Received(LINE[0], Learn(GENESIS, 1, lean, certificate)))
    assert [(effect.target, effect.message) for effect in step.effects if isinstance(effect, Send)] == [(LINE[0], AskLog(GENESIS, 0))]
    assert step.write is None
    few = replace(certificate, votes=(vote(A), vote(B)))
    assert at(B, State(book), Received(LINE[0], Learn(GENESIS, 1, lean, few))).effects == ()


def test_who_decides_tells_those_who_have_voted_without_the_body() -> None:
    """And all others whole."""
    state = at(A, State(BOOK), Ask(VALUE, 30.0)).after
    assert state.proposal.id is not None
    ballot = state.proposal.id.ballot
    facts = tuple(promise(number, ballot, NO_BALLOT) for number in (B, C))
    for number in (B, D):
        state = at(A, state, Received(LINE[number - 1], Accepted(GENESIS, state.proposal.id, bytes(32), facts))).after
    assert state.proposal.id is not None and state.proposal.id.phase is Phase.ACCEPT
    votes = tuple(signed(Vote(1, ballot, VALUE.digest, member(number)), GENESIS, key_of(member(number))) for number in (B, C))
    step = at(A, state, Received(LINE[1], Accepted(GENESIS, state.proposal.id, VALUE.digest, votes)))
    told = {
        effect.target: effect.message.value for effect in step.effects if isinstance(effect, Send) and isinstance(effect.message, Learn)
    }
    assert {number: value.body for number, value in told.items()} == {LINE[1]: b"", LINE[2]: b"", LINE[3]: GOOD, LINE[4]: GOOD}
    assert all(value == VALUE for value in told.values())


def test_who_hands_votes_home_decides_by_its_own_bytes() -> None:
    voted = at(B, State(BOOK), Received(LINE[0], accept(VALUE, A))).after
    lean = replace(voted.hops[0], value=replace(VALUE, body=b""))
    answer = Accepted(GENESIS, ProposalId(1, BALLOT, Phase.ACCEPT), VALUE.digest, (vote(A), vote(D), vote(E)))
    step = at(B, replace(voted, hops=(lean,)), Received(LINE[2], answer))
    assert [value.body for value in decided(step)] == [GOOD]


def promise(number: int, ballot: Ballot, accepted: Ballot) -> Promise:
    digest = VALUE.digest if accepted.counter else bytes(32)
    return signed(Promise(1, ballot, accepted, digest, member(number)), GENESIS, key_of(member(number)))


def test_what_was_begun_is_gone_on_with_as_it_was() -> None:
    """C asks for something; B and D promise, and name what A has begun. Who carries that to C has changed it, in one of the answers or both."""
    other = replace(BOOK.value("other", C), body=GOOD)

    def sent(*carried: Value) -> list[Value | None]:
        step = at(C, State(BOOK), Ask(other, 30.0))
        proposals = [effect.message for effect in step.effects if isinstance(effect, Send)]
        assert isinstance(proposals[0], Propose)
        proposal, state = proposals[0].proposal, step.after
        found: list[Value | None] = []
        for number, value in zip((B, D), carried, strict=True):
            answer = Accepted(GENESIS, proposal, bytes(32), (promise(number, proposal.ballot, BALLOT),), value)
            step = at(C, state, Received(LINE[number - 1], answer))
            state = step.after
            messages = [effect.message for effect in step.effects if isinstance(effect, Send)]
            found += [it.value for it in messages if isinstance(it, Propose) and it.proposal.phase is Phase.ACCEPT]
        return found

    def bodies(values: list[Value | None]) -> set[bytes]:
        return {b"" if value is None else value.body for value in values}

    assert bodies(sent(VALUE, VALUE)) == bodies(sent(BENT, VALUE)) == bodies(sent(VALUE, BENT)) == {GOOD}
    assert sent(BENT, BENT) == [], "without its bytes nothing is voted for"


def test_who_has_voted_hands_on_its_own_bytes() -> None:
    voted = at(B, State(BOOK), Received(LINE[0], accept(VALUE, A))).after
    ballot = Ballot(2, LINE[2])
    facts = (promise(C, ballot, Ballot(0, LINE[0])), promise(A, ballot, BALLOT))
    prepare = Propose(GENESIS, ProposalId(1, ballot, Phase.PREPARE), LINE, facts, highest=BENT, takeover=True)
    step = at(B, voted, Received(LINE[2], prepare), now=100.0)
    shown = [effect.message.highest for effect in step.effects if isinstance(effect, Send) and isinstance(effect.message, Propose)]
    assert [None if value is None else value.body for value in shown] == [GOOD]
