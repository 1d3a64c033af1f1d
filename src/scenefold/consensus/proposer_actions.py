"""Actions of the proposer's table (specs/25-consensus.md, The proposer)."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.ballots import first_ballot
from scenefold.consensus.effects import Outcome, Reply
from scenefold.consensus.effort import Effort
from scenefold.consensus.hops import proof_in
from scenefold.consensus.messages import Propose
from scenefold.consensus.routes import Route, arms, first_of, in_line, straight_to
from scenefold.consensus.state import NEVER, Proposal
from scenefold.consensus.tables import acting
from scenefold.consensus.timing import Timer, Waits
from scenefold.consensus.values import Value
from scenefold.wire import Phase, ProposalId

# --------------------------------------------------------------------------------------------------------- beginning


def begin(effort: Effort) -> None:
    """remember who asked, for what and until when; the wait for the deadline begins"""
    ask = effort.asked
    assert ask is not None
    needs_consent = ask.needs_consent or ask.is_for_all or ask.value is None
    wanted = Proposal(
        wish=ask.value,
        is_asked=True,
        is_for_all=ask.is_for_all,
        is_forced=ask.is_forced,
        needs_consent=needs_consent,
        deadline=ask.deadline,
    )
    effort.case.change_proposal(wanted)
    left = max(0.0, ask.deadline - effort.case.view.now)
    effort.case.set_timer(Timer(Waits.DEADLINE), left, left)


def take_over(effort: Effort) -> None:
    """go for `accepted`, as if it had been asked for"""
    accepted = effort.case.slot.accepted
    assert accepted is not None
    deadline = effort.case.view.now + effort.case.setting.timing.takeover_s
    effort.case.change_proposal(Proposal(wish=accepted.value, deadline=deadline))


def open_ballot(effort: Effort) -> None:
    """make a ballot above all that were met, and promise it, durably; the facts are this promise"""
    case, ballot = effort.case, effort.next_ballot()
    assert ballot is not None
    accepted = case.slot.accepted
    effort.change(
        id=ProposalId(case.open_position, ballot, Phase.PREPARE),
        route=in_line(case.participants.nodes, case.view.line),
        facts=(case.promise(ballot),),
        values=() if accepted is None else (accepted.value,),
        chosen=None,
        reason=RejectReason.NO_MAJORITY,
        by=None,
        before=(effort.proposal.reason, effort.proposal.by),
    )


def vote_first(effort: Effort) -> None:
    """vote for what was asked for in the first ballot, durably; it is exposed with that; the facts are this vote"""
    case, wish = effort.case, effort.proposal.wish
    assert wish is not None
    ballot = first_ballot(case.me)
    fact = case.vote(ballot, wish)
    case.change_slot(case.slot.expose(wish))
    effort.change(
        id=ProposalId(case.open_position, ballot, Phase.ACCEPT),
        route=in_line(case.participants.nodes, case.view.line),
        facts=(fact,),
        chosen=wish,
    )


def vote(effort: Effort) -> None:
    """choose the value, and vote for it, durably; if it is the one that was asked for, it is exposed with that; the facts are this vote"""
    case, proposal, choice = effort.case, effort.proposal, effort.choice()
    assert choice is not None and choice.value is not None and proposal.id is not None
    fact = case.vote(proposal.id.ballot, choice.value)
    if proposal.is_asked and choice.value == proposal.wish:
        case.change_slot(case.slot.expose(choice.value))
    effort.change(id=replace(proposal.id, phase=Phase.ACCEPT), facts=(fact,), chosen=choice.value, has_voted=True)


def hear(effort: Effort) -> None:
    """the wait for T_ORPHAN begins anew, so that what this node has begun and given up is taken over by itself, if by nobody else"""
    effort.case.hear()


# ----------------------------------------------------------------------------------------------------------- sending


def send_out(effort: Effort) -> None:
    """send 7 out by both arms, or straight to all that can be reached if its values are small and not every other ballot came to nothing, and wait T_PASS"""
    case, route = effort.case, effort.proposal.route
    others = [node for node in route if node != case.me]
    # Whom this node cannot reach others may.
    goes_straight = case.state.tries % 2 == 0
    if goes_straight and len(others) * _bytes(effort) <= case.setting.at_once_bytes:
        reached = [node for node in others if node in case.view.reachable]
        _send(effort, {node: straight_to(route, case.me, node) for node in reached}, _pass_s(effort, 1))
        return
    both = arms(route, case.me)
    firsts = [first for arm in both if (first := first_of(arm, case.view.reachable)) is not None]
    _send(effort, dict.fromkeys(firsts, route), _pass_s(effort, max(len(arm) for arm in both)))


def repeat(effort: Effort) -> None:
    """send 7 once more, straight to each whose fact is missing, and wait T_PASS, for longer the more ballots came to nothing though a majority of P(L) can be reached"""
    case, proposal = effort.case, effort.proposal
    assert proposal.id is not None
    there = {fact.member.node for fact in proposal.facts}
    ways = {node: straight_to(proposal.route, case.me, node) for node in proposal.route if node not in there}
    # Who cannot be reached is not slow.
    tries = case.state.tries if case.reaches_majority else 0
    _send(effort, ways, case.setting.timing.repeat_s(1, proposal.id.ballot.counter, tries))


def _pass_s(effort: Effort, arm: int) -> float:
    assert effort.proposal.id is not None
    return effort.case.setting.timing.pass_s(arm, effort.proposal.id.ballot.counter)


def _brought(effort: Effort) -> tuple[Value | None, Value | None]:
    """`highest` and `value` of the 7 that this phase sends."""
    slot, proposal = effort.case.slot, effort.proposal
    if proposal.id is not None and proposal.id.phase is Phase.ACCEPT:
        return None, proposal.chosen
    return None if slot.accepted is None else slot.accepted.value, proposal.wish


def _bytes(effort: Effort) -> int:
    return sum(len(value.data) + len(value.body) for value in _brought(effort) if value is not None)


def _send(effort: Effort, ways: dict[NodeId, Route], wait_s: float) -> None:
    case, proposal = effort.case, effort.proposal
    assert proposal.id is not None
    highest, value = _brought(effort)
    is_takeover = proposal.is_forced or not proposal.is_asked or proposal.wish is None or proposal.digest in case.slot.exposed
    for node, route in ways.items():
        case.send(node, Propose(case.setting.genesis, proposal.id, route, proposal.facts, highest, value, is_takeover))
    effort.change(arms=frozenset(ways))
    if ways:
        case.set_timer(Timer(Waits.ANSWERS, proposal.id), wait_s, wait_s)


# ----------------------------------------------------------------------------------------------------------- waiting


def note(effort: Effort) -> None:
    """remember of a refusal its reason, who refused, and the hint; after a 2: ask that one for the log"""
    refusal = effort.refusal
    if refusal is None:
        return
    met = refusal.hint if effort.proposal.met is None else max(effort.proposal.met, refusal.hint)
    is_behind = refusal.reason is RejectReason.POSITION_BEHIND
    effort.change(met=met, reason=refusal.reason, by=refusal.member.node, is_behind=effort.proposal.is_behind or is_behind)
    if is_behind:
        effort.case.ask_log(refusal.member.node)


def note_who_is_missing(effort: Effort) -> None:
    """remember reason 3, and one that seems alive and has not promised"""
    effort.change(reason=RejectReason.PEER_MISSED, by=effort.missing())


def note_overtaken(effort: Effort) -> None:
    """if a majority of P(L) can be reached: remember reason 1, and the node of the ballot that was promised since"""
    if effort.case.reaches_majority:
        effort.change(reason=RejectReason.POSITION_TAKEN, by=effort.case.slot.promised.node)


def rest(effort: Effort) -> None:
    """pause for between T_BASE and T_BASE · 2^k, k being the number of this node's ballots for L so far, whoever asked, at most 6"""
    tries = effort.case.count_try()
    effort.case.set_timer(Timer(Waits.REST, effort.proposal.id), *effort.case.setting.timing.rest_s(tries))


def wait_again(effort: Effort) -> None:
    """the wait for T_ORPHAN begins anew"""
    effort.case.watch()


# ------------------------------------------------------------------------------------------------------------ ending


def decide(effort: Effort) -> None:
    """L is decided here, and everybody of P(L) and P(L + 1) is told (6)"""
    case, proposal = effort.case, effort.proposal
    assert proposal.id is not None and proposal.chosen is not None
    proof = proof_in(case, proposal.id, proposal.chosen.digest, proposal.facts)
    assert proof is not None
    case.decide(proposal.chosen, proof)
    case.tell_everybody()


def say_committed(effort: Effort) -> None:
    """answer COMMITTED"""
    assert effort.case.decided is not None
    effort.case.do(Reply(effort.proposal.digest, Outcome.COMMITTED, effort.case.decided.position))


def say_committed_there(effort: Effort) -> None:
    """answer COMMITTED, with that position"""
    wish = effort.asked_value
    position = None if wish is None else effort.case.state.judge.found(wish)
    assert wish is not None and position is not None
    effort.case.do(Reply(wish.digest, Outcome.COMMITTED, position))


def say_unknown(effort: Effort) -> None:
    """answer UNKNOWN"""
    effort.case.do(Reply(effort.proposal.digest, Outcome.UNKNOWN, effort.case.open_position))


def say_unknown_of_it(effort: Effort) -> None:
    """answer UNKNOWN of what is asked for"""
    wish = effort.asked_value
    assert wish is not None
    effort.case.do(Reply(wish.digest, Outcome.UNKNOWN, effort.case.open_position))


def say_open(effort: Effort) -> None:
    """answer OPEN"""
    effort.case.do(Reply(None, Outcome.OPEN, effort.case.open_position))


def reject(effort: Effort) -> None:
    """answer REJECTED with this reason"""
    assert effort.row is not None and effort.row.reason is not None
    _reject(effort, effort.row.reason, effort.case.me)


def reject_as_judged(effort: Effort) -> None:
    """answer REJECTED with the judge's reason"""
    wish = effort.asked_value
    reason = None if wish is None else effort.case.state.judge.refuses(wish)
    assert reason is not None
    _reject(effort, reason, effort.case.me)


def reject_as_refused(effort: Effort) -> None:
    """answer REJECTED with the reason of the refusal, and by whom"""
    assert effort.refusal is not None
    _reject(effort, effort.refusal.reason, effort.refusal.member.node)


def reject_as_noted(effort: Effort) -> None:
    """answer REJECTED with what was remembered of the newest ballot, while that is under way of the one before, or 15"""
    _reject(effort, *effort.proposal.noted)


def let_go(effort: Effort) -> None:
    """nobody waits for it any more: what is under way comes to its end, and no other ballot follows"""
    effort.change(is_asked=False, deadline=NEVER)


def _reject(effort: Effort, reason: RejectReason, by: NodeId | None) -> None:
    case = effort.case
    wish = effort.proposal.wish if effort.asked is None else effort.asked_value
    position = case.open_position if case.decided is None else case.decided.position
    case.do(Reply(None if wish is None else wish.digest, Outcome.REJECTED, position, reason, by))


ACTIONS = acting(
    (
        begin,
        take_over,
        open_ballot,
        vote_first,
        vote,
        hear,
        send_out,
        repeat,
        note,
        note_who_is_missing,
        note_overtaken,
        rest,
        wait_again,
        decide,
        say_committed,
        say_committed_there,
        say_unknown,
        say_unknown_of_it,
        say_open,
        reject,
        reject_as_judged,
        reject_as_refused,
        reject_as_noted,
        let_go,
    )
)
