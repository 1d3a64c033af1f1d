"""A node's own proposals: one at a time for each log (specs/25-consensus.md, The proposer)."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.consensus.case import Case
from scenefold.consensus.effort import Effort
from scenefold.consensus.events import Ask
from scenefold.consensus.hops import come_home
from scenefold.consensus.messages import Answer
from scenefold.consensus.proposer_actions import ACTIONS
from scenefold.consensus.proposer_guards import GUARDS
from scenefold.consensus.proposer_table import ANSWERED, ASK, DECIDED, LATE, ORPHANED, PROPOSER, REFUSED, RESTED, WAITED
from scenefold.consensus.state import IDLE, Stage
from scenefold.consensus.tables import first_fit
from scenefold.wire import ProposalId

_ALONE = (Stage.PREPARING, Stage.ACCEPTING)
"""If nobody was there to send to, all that can come has come."""


def ask(case: Case, event: Ask) -> None:
    """Somebody wants something decided."""
    _run(ASK, Effort(case, event))


def orphaned(case: Case) -> None:
    """Of what this node has voted for nothing was heard for T_ORPHAN."""
    _run(ORPHANED, Effort(case))


def answered(case: Case, sender: NodeId, message: Answer) -> None:
    """An 8 or 9. If it is not of the present ballot it is looked at like one on the way home: its facts are true, too."""
    if message.proposal != case.proposal.id or message.genesis != case.setting.genesis:
        come_home(case, sender, message)
        return
    effort = Effort(case)
    effort.take(sender, message)
    _run(ANSWERED if effort.refusal is None else REFUSED, effort)


def pass_over(case: Case, proposal: ProposalId | None) -> None:
    """T_PASS is over; that of an earlier ballot is nobody's business."""
    if proposal == case.proposal.id:
        _run(WAITED, Effort(case))


def rested(case: Case, proposal: ProposalId | None) -> None:
    """The pause is over."""
    if proposal == case.proposal.id:
        _run(RESTED, Effort(case))


def late(case: Case) -> None:
    """Whoever asks waits no longer."""
    _run(LATE, Effort(case))


def lose_link(case: Case, node: NodeId) -> None:
    """What was sent to a node may not have come."""
    effort = Effort(case)
    if effort.lose(node):
        _run(WAITED, effort)


def decided(case: Case) -> None:
    """The position that was open is decided, in whatever way."""
    _run(DECIDED, Effort(case))


def _run(event: str, effort: Effort) -> None:
    while True:
        effort.row = row = first_fit(PROPOSER, event, effort.proposal.stage, GUARDS, effort)
        if row is None:
            return
        for name in row.do:
            ACTIONS[name](effort)
        if row.then is None:
            return
        effort.case.change_proposal(IDLE if row.then is Stage.IDLE else replace(effort.proposal, stage=row.then))
        if row.then not in _ALONE or effort.proposal.arms:
            return
        event = ANSWERED
