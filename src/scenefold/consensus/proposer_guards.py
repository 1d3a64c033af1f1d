"""Guards of the proposer's table (specs/25-consensus.md, The proposer)."""

from __future__ import annotations

from scenefold.base.reasons import RejectReason
from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.choosing import named_highest
from scenefold.consensus.effort import Effort
from scenefold.consensus.hops import proof_in
from scenefold.consensus.tables import named
from scenefold.wire import Phase

_FOR_GOOD = frozenset(
    {
        RejectReason.PEER_MISSED,
        RejectReason.SIGNATURE_INVALID,
        RejectReason.ILL_FORMED,
        RejectReason.MODE_FORBIDS,
        RejectReason.NOT_AUTHORISED,
        RejectReason.BUSY,
    }
)
"""Reasons that do not go away by trying again at once."""


def found(effort: Effort) -> bool:
    """what is asked for is decided at a position here"""
    wish = effort.asked_value
    return wish is not None and effort.case.state.judge.found(wish) is not None


def takes_no_part(effort: Effort) -> bool:
    """this incarnation of this node is not in P(L)"""
    return not effort.case.takes_part


def cannot_write(effort: Effort) -> bool:
    """the disk refuses"""
    return not effort.case.view.can_write


def ill_formed(effort: Effort) -> bool:
    """the judge refuses at L what is asked for"""
    wish = effort.asked_value
    return wish is not None and effort.case.state.judge.refuses(wish) is not None


def under_way(effort: Effort) -> bool:
    """what is asked for was in an ACCEPT of this node at L, is `accepted`, or is what this node proposes at this moment"""
    wish, slot = effort.asked_value, effort.case.slot
    return wish is not None and wish.digest in slot.exposed | {slot.accepted_digest, effort.proposal.digest}


def no_ballot_left(effort: Effort) -> bool:
    """a ballot with the highest counter that there is was met"""
    return effort.next_ballot() is None


def has_the_first_ballot(effort: Effort) -> bool:
    """there is a value, which needs nobody's consent; this node is the first of P(L), and has promised and voted for nothing at L; and a majority of P(L) can be reached"""
    case, ask = effort.case, effort.asked
    if ask is None or ask.value is None or ask.needs_consent or ask.is_for_all:
        return False
    if case.participants.first != case.me or case.slot.promised != NO_BALLOT or case.slot.accepted is not None:
        return False
    return case.reaches_majority


def nothing_accepted(effort: Effort) -> bool:
    """`accepted` is none"""
    return effort.case.slot.accepted is None


def for_good(effort: Effort) -> bool:
    """the reason is one that does not go away by trying again at once"""
    return effort.refusal is not None and effort.refusal.reason in _FOR_GOOD


def nothing_begun(effort: Effort) -> bool:
    """`accepted` is none, no promise names any, somebody waits, and what was asked for is not in doubt, and no barrier"""
    slot, proposal = effort.case.slot, effort.proposal
    is_new = slot.accepted is None and named_highest(proposal.facts) is None
    return is_new and proposal.is_asked and proposal.wish is not None and not in_doubt(effort)


def arms_are_out(effort: Effort) -> bool:
    """an arm has not answered yet"""
    return bool(effort.proposal.arms)


def needs_consent(effort: Effort) -> bool:
    """somebody may have something against it (26-modes), or it is a barrier or a takeover"""
    return effort.proposal.needs_consent


def in_the_second_phase(effort: Effort) -> bool:
    """it is the second phase of the ballot that came to nothing"""
    return effort.proposal.id is not None and effort.proposal.id.phase is Phase.ACCEPT


def overtaken(effort: Effort) -> bool:
    """this node has promised a higher ballot since"""
    return effort.proposal.id is None or effort.case.slot.promised != effort.proposal.id.ballot


def too_few_promises(effort: Effort) -> bool:
    """no majority has promised, or the bytes of the value are not there"""
    return effort.choice() is None


def not_all_agree(effort: Effort) -> bool:
    """it is to be for all, the value is the one that was asked for, and of P(L) somebody seems alive and has not promised"""
    choice = effort.choice()
    return effort.proposal.is_for_all and choice is not None and choice.value == effort.proposal.wish and effort.missing() is not None


def nothing_to_propose(effort: Effort) -> bool:
    """it is a barrier, and no promise names a value"""
    choice = effort.choice()
    return choice is not None and choice.value is None


def voted_by_a_majority(effort: Effort) -> bool:
    """the votes are a certificate, and the disk takes it"""
    proposal = effort.proposal
    if proposal.id is None or proposal.chosen is None:
        return False
    return proof_in(effort.case, proposal.id, proposal.chosen.digest, proposal.facts) is not None


def deadline_over(effort: Effort) -> bool:
    """the deadline is over"""
    return effort.case.view.now >= effort.proposal.deadline


def nobody_waits(effort: Effort) -> bool:
    """it is a takeover that nobody has asked for; or whoever asked was told something already"""
    return not effort.proposal.is_asked


def in_doubt(effort: Effort) -> bool:
    """what was asked for was in an ACCEPT of this node at L, or is `accepted`; or somebody has refused it since L is decided; or it is a barrier, and this node has voted for what its promises named"""
    proposal, slot = effort.proposal, effort.case.slot
    digest = proposal.digest
    if digest is None:
        return proposal.has_met_something
    return digest in slot.exposed or digest == slot.accepted_digest or proposal.is_behind


def is_the_wish(effort: Effort) -> bool:
    """it is what was asked for; or it was a barrier"""
    assert effort.case.decided is not None
    return effort.proposal.wish is None or effort.case.decided.value == effort.proposal.wish


GUARDS = named(
    (
        found,
        takes_no_part,
        cannot_write,
        ill_formed,
        under_way,
        no_ballot_left,
        has_the_first_ballot,
        nothing_accepted,
        for_good,
        nothing_begun,
        arms_are_out,
        needs_consent,
        in_the_second_phase,
        overtaken,
        too_few_promises,
        not_all_agree,
        nothing_to_propose,
        voted_by_a_majority,
        deadline_over,
        nobody_waits,
        in_doubt,
        is_the_wish,
    )
)
