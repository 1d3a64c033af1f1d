"""If this fails, somebody is removed without having been asked, or nobody ever is."""

from __future__ import annotations

import datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from scenefold.base.ids import NodeId, node_id_of
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.membership.removal import UNREGISTERED_FACTOR, Evidence, removal_veto, silence_needed_s
from scenefold.peer.membership.suspicion import (
    AGAIN_S,
    CLEARED_S,
    FRESH_S,
    PROBES_MAX,
    REFUSED_AGAIN_S,
    SILENT_ROUNDS_MIN,
    TRANSITIONS,
    Cause,
    Event,
    State,
    Suspect,
    Suspicion,
)
from scenefold.wire import Member

ME, PEER, HELPER = (node_id_of(f"127.0.0.{last}") for last in (2, 3, 4))
MEMBER = Member(PEER, b"i" * 16)
REMOVE_AFTER_S = 120.0


def suspected(at: float = 0.0, cause: Cause = Cause.LEASE_LAPSED) -> Suspicion:
    suspicion = Suspicion(REMOVE_AFTER_S)
    assert suspicion.suspect(MEMBER, cause, 3, at)
    return suspicion


def probed(suspicion: Suspicion, now: float, *, hold_back_s: float = 0.0, helpers: tuple[NodeId, ...] = (HELPER,)) -> Suspect:
    (suspect,) = suspicion.turn(now)
    suspicion.nobody_hears(suspect, helpers, hold_back_s, now + 2.0)
    return suspect


def to_propose(suspicion: Suspicion, now: float, proof_at: float = 0.0) -> list[Suspect]:
    return suspicion.to_propose(lambda _suspect: proof_at, now)


# ------------------------------------------------------------------------------------------------------------ the way


def test_the_way_from_a_cause_to_a_proposal() -> None:
    suspicion = suspected()
    assert suspicion.state(PEER) is State.SUSPECTED
    (suspect,) = suspicion.turn(0.0)
    assert suspicion.state(PEER) is State.PROBING and suspicion.turn(0.0) == []
    suspicion.nobody_hears(suspect, (HELPER,), 0.0, 3.0)
    assert suspicion.state(PEER) is State.SILENT
    assert to_propose(suspicion, 30.0) == [], "it was heard less than two minutes ago"
    now = 3.0
    for pause_s in (*AGAIN_S, *[AGAIN_S[-1]] * 8):
        now += pause_s
        probed(suspicion, now)
        now += 2.0
    assert to_propose(suspicion, now) == [suspect] and suspicion.state(PEER) is State.PROPOSED
    assert to_propose(suspicion, now) == [], "once is enough"


def test_the_reason_says_how_long_why_and_who_asked() -> None:
    suspect = probed(suspected(cause=Cause.REQUEST_FAILED), 0.0)
    assert suspect.reason(ME, 131.4, datetime.datetime(2027, 3, 1, 13, 20, tzinfo=datetime.UTC)) == (
        "not heard for 131 s until 2027-03-01 13:20 UTC (a request to it failed); no answer in 1 rounds of probing, the last by 127.0.0.2, 127.0.0.4"
    )


def test_who_is_heard_is_cleared_and_left_in_peace_for_a_while() -> None:
    suspicion = suspected()
    (suspect,) = suspicion.turn(0.0)
    suspicion.heard(suspect, 1.0)
    assert suspicion.state(PEER) is State.CLEARED and suspicion.suspects == []
    suspicion.review(lambda _member: 9, 1.0 + CLEARED_S - 0.1)
    assert not suspicion.suspect(MEMBER, Cause.LEASE_LAPSED, 9, 2.0), "the cause may last: a one-way cut does"
    suspicion.review(lambda _member: 9, 1.0 + CLEARED_S)
    assert suspicion.state(PEER) is None
    assert suspicion.suspect(MEMBER, Cause.LEASE_LAPSED, 9, 20.0)


def test_if_nobody_can_be_asked_nothing_is_confirmed() -> None:
    suspicion = suspected()
    for now in (0.0, 10.0, 30.0, 60.0, 90.0, 119.0, 140.0):
        (suspect,) = suspicion.turn(now)
        suspicion.nobody_to_ask(suspect, now)
    assert suspicion.state(PEER) is State.SUSPECTED and to_propose(suspicion, 141.0) == []


def test_a_proposal_rests_on_fresh_probes() -> None:
    suspicion = suspected()
    for now in (0.0, 20.0, 40.0):
        probed(suspicion, now)
    assert to_propose(suspicion, 42.0 + FRESH_S + 60.0) == []
    probed(suspicion, 150.0)
    assert len(to_propose(suspicion, 153.0)) == 1


def test_a_proposal_rests_on_several_rounds_of_probes() -> None:
    suspicion = suspected(at=200.0)
    for now in (200.0, 210.0):
        probed(suspicion, now)
        assert to_propose(suspicion, now + 2.0) == []
    suspicion.nobody_to_ask(*suspicion.turn(220.0), 222.0)
    assert to_propose(suspicion, 222.0) == [], "a round that says nothing is none"
    suspect = probed(suspicion, 240.0)
    assert to_propose(suspicion, 242.0) == [suspect]


def test_who_proposes_leaves_it_to_others_first() -> None:
    suspicion = suspected()
    probed(suspicion, 0.0, hold_back_s=130.0)
    probed(suspicion, 60.0, hold_back_s=999.0)
    probed(suspicion, 117.0, hold_back_s=999.0)
    assert to_propose(suspicion, 131.9) == []
    assert len(to_propose(suspicion, 132.0)) == 1


def test_a_refused_removal_is_proposed_again_later_after_new_probes() -> None:
    suspicion = suspected()
    suspect = [probed(suspicion, now) for now in (60.0, 90.0, 119.0)][-1]
    assert to_propose(suspicion, 125.0) == [suspect]
    suspicion.refused(suspect, 126.0)
    probed(suspicion, 126.0)
    assert to_propose(suspicion, 126.0 + REFUSED_AGAIN_S - 0.1) == []
    assert to_propose(suspicion, 126.0 + REFUSED_AGAIN_S) == [suspect]


@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_news_end_the_matter_at_every_step(steps: int) -> None:
    suspicion = suspected()
    if steps == 1:
        suspicion.turn(0.0)
    if steps >= 2:
        for now in (60.0, 90.0, 119.0):
            probed(suspicion, now)
    if steps == 3:
        assert to_propose(suspicion, 122.0)
    suspicion.review(lambda _member: 3, 122.0)
    assert suspicion.state(PEER) is not None, "no news"
    suspicion.review(lambda _member: 4, 122.0)
    assert suspicion.state(PEER) is None


def test_who_is_no_member_any_more_is_no_suspect() -> None:
    suspicion = suspected()
    suspicion.review(lambda _member: None, 1.0)
    assert suspicion.state(PEER) is None


def test_an_answer_that_comes_too_late_changes_nothing() -> None:
    suspicion = suspected()
    (late,) = suspicion.turn(0.0)
    suspicion.review(lambda _member: 4, 1.0)
    assert suspicion.suspect(MEMBER, Cause.UNLIKELY, 4, 2.0)
    (suspect,) = suspicion.turn(2.0)
    suspicion.nobody_hears(late, (), 0.0, 3.0)
    suspicion.heard(late, 3.0)
    assert suspicion.state(PEER) is State.PROBING and suspect.rounds == 0


def test_a_new_incarnation_is_another_suspect() -> None:
    suspicion = suspected()
    old = probed(suspicion, 0.0)
    assert suspicion.suspect(Member(PEER, b"j" * 16), Cause.UNLIKELY, 0, 5.0)
    assert suspicion.state(PEER) is State.SUSPECTED and suspicion.suspects != [old]


def test_few_are_probed_at_a_time_and_everybody_has_a_turn() -> None:
    suspicion = Suspicion(REMOVE_AFTER_S)
    members = [Member(NodeId(PEER + index), b"i" * 16) for index in range(100)]
    for member in members:
        suspicion.suspect(member, Cause.UNLIKELY, 0, 0.0)
    seen: set[NodeId] = set()
    for now in range(13):
        suspects = suspicion.turn(now * 5.0)
        assert len(suspects) <= PROBES_MAX
        seen |= {suspect.node for suspect in suspects}
        for suspect in suspects:
            suspicion.nobody_hears(suspect, (), 0.0, now * 5.0 + 4.0)
    assert len(seen) == 100


def test_the_table_is_complete() -> None:
    assert {state for state, _event in TRANSITIONS} == set(State) - {State.CLEARED}, "cleared ends by time, not by an event"
    assert set(TRANSITIONS.values()) == set(State)
    assert {event for _state, event in TRANSITIONS} == set(Event)


class Neighbourhood(RuleBasedStateMachine):
    """Whatever happens in whatever order: nobody is proposed without fresh silence, and with news."""

    def __init__(self) -> None:
        super().__init__()
        self.suspicion = Suspicion(REMOVE_AFTER_S)
        self.now, self.signs, self.proof_at = 0.0, 0, 0.0
        self.under_way: list[Suspect] = []
        self.proposed: list[Suspect] = []
        self.last_silence: float | None = None
        self.silences = 0

    @rule(seconds=st.floats(0.1, 60.0))
    def wait(self, seconds: float) -> None:
        self.now += seconds

    @rule(cause=st.sampled_from(Cause))
    def suspect(self, cause: Cause) -> None:
        if self.suspicion.suspect(MEMBER, cause, self.signs, self.now):
            self.last_silence = None
            self.silences = 0

    @rule()
    def look(self) -> None:
        self.suspicion.review(lambda _member: self.signs, self.now)
        self.under_way += self.suspicion.turn(self.now)
        found = self.suspicion.to_propose(lambda _suspect: self.proof_at, self.now)
        for suspect in found:
            assert self.now - self.proof_at >= REMOVE_AFTER_S
            assert suspect.signs == self.signs, "there are news of it"
            assert self.last_silence is not None and self.now - self.last_silence <= FRESH_S
            assert self.silences >= SILENT_ROUNDS_MIN
        self.proposed += found

    @rule()
    def be_heard(self) -> None:
        self.signs += 1
        self.proof_at = self.now

    @precondition(lambda self: self.under_way)
    @rule(answer=st.sampled_from(["heard", "silent", "unsure"]))
    def probe_ends(self, answer: str) -> None:
        suspect = self.under_way.pop(0)
        is_current = self.suspicion.state(PEER) is State.PROBING and suspect in self.suspicion.suspects
        if answer == "heard":
            self.suspicion.heard(suspect, self.now)
        elif answer == "unsure":
            self.suspicion.nobody_to_ask(suspect, self.now)
        else:
            self.suspicion.nobody_hears(suspect, (), 0.0, self.now)
            if is_current:
                self.last_silence = self.now
                self.silences += 1

    @precondition(lambda self: self.proposed)
    @rule()
    def proposal_is_refused(self) -> None:
        self.suspicion.refused(self.proposed.pop(), self.now)

    @invariant()
    def one_probe_at_a_time(self) -> None:
        assert sum(suspect.state is State.PROBING for suspect in self.suspicion.suspects) <= 1


TestNeighbourhood = Neighbourhood.TestCase

# ------------------------------------------------------------------------------------------------------------ the veto


def evidence(**changes: object) -> Evidence:
    values: dict[str, object] = {"is_voter": False, "proof_at": 0.0, "leased_at": None, "members": 5, "members_proven": 4, **changes}
    return Evidence(**values)  # type: ignore[arg-type]


def test_nothing_speaks_for_a_dead_one() -> None:
    assert removal_veto(MEMBER, evidence(), REMOVE_AFTER_S, REMOVE_AFTER_S) is None


@pytest.mark.parametrize(
    "case, text",
    [
        (evidence(is_voter=True), "never removed"),
        (evidence(proof_at=1.0), "lived 119 s ago"),
        (evidence(leased_at=5.0), "lived 115 s ago"),
        (evidence(members_proven=2), "may be cut off itself"),
        (evidence(members=1000, members_proven=499), "may be cut off itself"),
    ],
)
def test_what_the_voter_knows_prevents_a_removal(case: Evidence, text: str) -> None:
    objection = removal_veto(MEMBER, case, REMOVE_AFTER_S, REMOVE_AFTER_S)
    assert objection is not None and text in objection


@pytest.mark.parametrize("members, proven", [(2, 1), (4, 2), (1000, 500)])
def test_half_of_the_members_are_enough(members: int, proven: int) -> None:
    assert removal_veto(MEMBER, evidence(members=members, members_proven=proven), REMOVE_AFTER_S, REMOVE_AFTER_S) is None


def test_a_founder_that_never_came_is_waited_for() -> None:
    founder = Member(PEER, NO_INCARNATION)
    assert silence_needed_s(founder, REMOVE_AFTER_S) == UNREGISTERED_FACTOR * REMOVE_AFTER_S
    assert removal_veto(founder, evidence(), REMOVE_AFTER_S, 4 * REMOVE_AFTER_S) is not None
    assert removal_veto(founder, evidence(), REMOVE_AFTER_S, 5 * REMOVE_AFTER_S) is None


@given(st.floats(0, 1e4), st.floats(0, 1e4) | st.none(), st.floats(0, 2e4), st.integers(1, 1024), st.integers(1, 1024))
def test_nobody_goes_who_lived_of_late(proof_at: float, leased_at: float | None, now: float, members: int, proven: int) -> None:
    case = evidence(proof_at=proof_at, leased_at=leased_at, members=members, members_proven=proven)
    if removal_veto(MEMBER, case, REMOVE_AFTER_S, now) is None:
        assert now - max(proof_at, leased_at or 0.0) >= REMOVE_AFTER_S and 2 * proven >= members
