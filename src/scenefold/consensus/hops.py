"""Handing proposals on, and their answers home (specs/25-consensus.md, On the way home).

What a hop remembers of it saves time and nothing else: whoever has forgotten sends what comes to the originator straight away.
"""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.consensus.case import Case
from scenefold.consensus.certificates import Certificate, certificate_of
from scenefold.consensus.choosing import highest_of
from scenefold.consensus.facts import Fact, merged, true_facts
from scenefold.consensus.hops_table import HOME, HOP_OVER, HOPS
from scenefold.consensus.messages import Accepted, Answer, Propose
from scenefold.consensus.routes import beyond, first_of, homeward
from scenefold.consensus.state import Hop
from scenefold.consensus.tables import acting, first_fit, named
from scenefold.consensus.timing import Timer, Waits
from scenefold.consensus.values import Value
from scenefold.wire import Phase, ProposalId

HOPS_MAX = 16
"""Proposals of others that a node remembers: of each participant that is at it, two phases are more than are ever open."""


def hand_on_from(case: Case, sender: NodeId, message: Propose) -> None:
    """Send a proposal on, away from its originator; if there is nobody further out, answer for all."""
    proposal = message.proposal
    further = beyond(message.route, proposal.ballot.node, case.me)
    target = first_of(further, case.view.reachable)
    if target is None:
        case.send(sender, Accepted(message.genesis, proposal, message.digest, message.facts, message.highest))
        return
    case.send(target, message)
    value = message.highest if proposal.phase is Phase.PREPARE else message.value
    if proposal.position <= case.state.position:
        # It was decided just now.
        value = None
    hop = Hop(proposal, message.digest, sender, target, message.route, message.facts, value)
    others = [other for other in case.state.hops if other.proposal != proposal]
    case.state = replace(case.state, hops=(*others, hop)[-HOPS_MAX:])
    wait = case.setting.timing.hops_s(len(further), proposal.ballot.counter)
    case.set_timer(Timer(Waits.HOP, proposal), wait, wait)


class Return:
    """What has come back of a proposal, or has not: `message` and its `sender` are None if the time for it is over."""

    def __init__(self, case: Case, proposal: ProposalId, message: Answer | None = None, sender: NodeId | None = None) -> None:
        self.case, self.proposal, self.message, self.sender = case, proposal, message, sender
        self.hop = next((hop for hop in case.state.hops if hop.proposal == proposal), None)
        known, new = () if self.hop is None else self.hop.facts, () if message is None else message.facts
        if proposal.position == case.open_position and message is not None:
            known, new = (true_facts(group, proposal, message.digest, case.setting.genesis, case.participants) for group in (known, new))
        self.facts = merged(known, new)


def come_home(case: Case, sender: NodeId, message: Answer) -> None:
    """An answer to a proposal that is not the one this node waits for."""
    _take(HOME, Return(case, message.proposal, message, sender))


def hop_over(case: Case, proposal: ProposalId) -> None:
    """Nothing has come back in time, or nothing can."""
    _take(HOP_OVER, Return(case, proposal))


def lose_link(case: Case, node: NodeId) -> None:
    """Whatever was handed on to this node comes back by this way no more."""
    for hop in case.state.hops:
        if hop.downstream == node:
            hop_over(case, hop.proposal)


def _take(event: str, back: Return) -> None:
    row = first_fit(HOPS, event, None, GUARDS, back)
    assert row is not None, "the last rows have no guards"
    for name in row.do:
        ACTIONS[name](back)


def proof_in(case: Case, proposal: ProposalId, digest: bytes, facts: tuple[Fact, ...]) -> Certificate | None:
    """What these true facts show to be decided, if it is the open position and this node can write that down."""
    if proposal.phase is not Phase.ACCEPT or proposal.position != case.open_position or not case.view.can_write:
        return None
    return certificate_of(proposal.position, proposal.ballot, digest, facts, case.participants)


# ------------------------------------------------------------------------------------------------------------ guards


def of_another_log(back: Return) -> bool:
    """it names another genesis"""
    return back.message is not None and back.message.genesis != back.case.setting.genesis


def shows_a_decision(back: Return) -> bool:
    """its facts, with those that this node handed on, are a certificate, L = c + 1, the value is here and not refused by the judge, and the disk takes it"""
    return _decision(back) is not None


def my_own(back: Return) -> bool:
    """this node is the originator, and waits for that no more"""
    return back.proposal.ballot.node == back.case.me


def brought_by_a_stranger(back: Return) -> bool:
    """neither a node of P(c + 1) has brought it, nor the one that this node handed it on to: whatever it holds, this node is not made to carry it, and waits on"""
    return back.sender not in back.case.participants.nodes and (back.hop is None or back.sender != back.hop.downstream)


def has_come_back(back: Return) -> bool:
    """it has been answered, or is forgotten"""
    return back.hop is None or not back.hop.is_waiting


# ----------------------------------------------------------------------------------------------------------- actions


def decide(back: Return) -> None:
    """L is decided here; if this node is the originator, everybody is told (6)"""
    found = _decision(back)
    assert found is not None
    back.case.decide(*found)
    if back.proposal.ballot.node == back.case.me:
        back.case.tell_everybody()


def pass_home(back: Return) -> None:
    """send it, with all facts, to whoever the proposal came from, or the next one homeward that can be reached, or the originator"""
    assert back.message is not None
    if back.proposal.ballot.node == back.case.me:
        return
    message: Answer = replace(back.message, facts=back.facts)
    if isinstance(message, Accepted):
        known = (message.highest, None if back.hop is None else back.hop.value)
        message = replace(message, highest=highest_of(back.facts, [value for value in known if value is not None]))
    back.case.send(_way_home(back), message)
    _answered(back)


def turn_round(back: Return) -> None:
    """answer 8 with what was known when it was handed on: it is as true as ever"""
    hop = back.hop
    assert hop is not None
    highest = hop.value if hop.proposal.phase is Phase.PREPARE else None
    back.case.send(_way_home(back), Accepted(back.case.setting.genesis, hop.proposal, hop.digest, hop.facts, highest))
    _answered(back)


def _decision(back: Return) -> tuple[Value, Certificate] | None:
    """What the facts show to be decided, if the value is here."""
    if back.message is None:
        return None
    accepted, digest = back.case.slot.accepted, back.message.digest
    values = (None if back.hop is None else back.hop.value, None if accepted is None else accepted.value)
    proof = proof_in(back.case, back.proposal, digest, back.facts)
    if proof is None:
        return None
    judge = back.case.state.judge
    # Its bytes as they were handed on may not be those that were voted for.
    fitting = (value for value in values if value is not None and value.digest == digest and judge.refuses(value, is_decided=True) is None)
    value = next(fitting, None)
    return None if value is None else (value, proof)


def _way_home(back: Return) -> NodeId:
    origin, reachable = back.proposal.ballot.node, back.case.view.reachable
    nearer = () if back.hop is None else (back.hop.upstream, *homeward(back.hop.route, origin, back.case.me))
    return first_of(nearer, reachable) or origin


def _answered(back: Return) -> None:
    """The hop is kept, as more may come."""
    hops = back.case.state.hops
    changed = tuple(replace(hop, is_waiting=False, facts=back.facts) if hop.proposal == back.proposal else hop for hop in hops)
    back.case.state = replace(back.case.state, hops=changed)


GUARDS = named((of_another_log, shows_a_decision, my_own, brought_by_a_stranger, has_come_back))
ACTIONS = acting((decide, pass_home, turn_round))
