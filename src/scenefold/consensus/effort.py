"""What a node's own proposal meets (specs/25-consensus.md, The proposer)."""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.consensus.ballots import NO_BALLOT, next_ballot
from scenefold.consensus.case import Case
from scenefold.consensus.choosing import Choice, choose
from scenefold.consensus.events import Ask
from scenefold.consensus.facts import Promise, Refusal, is_true, merged, true_facts
from scenefold.consensus.messages import Answer, Rejected
from scenefold.consensus.state import Proposal
from scenefold.consensus.tables import Row
from scenefold.consensus.values import NO_DIGEST, Value
from scenefold.wire import Ballot, Phase


class Effort:
    """An event of the own proposal. `asked`: what somebody has just asked for; `refusal`: a true one, of the present ballot."""

    def __init__(self, case: Case, asked: Ask | None = None) -> None:
        self.case, self.asked = case, asked
        self.refusal: Refusal | None = None
        self.row: Row | None = None

    @property
    def proposal(self) -> Proposal:
        return self.case.proposal

    def change(self, **changes: object) -> None:
        self.case.change_proposal(replace(self.proposal, **changes))  # type: ignore[arg-type]

    @property
    def asked_value(self) -> Value | None:
        return None if self.asked is None else self.asked.value

    def choice(self) -> Choice | None:
        """What the promises so far leave to be proposed; None if they are too few."""
        return choose(self.proposal.facts, self.proposal.values, self.proposal.wish, self.case.participants)

    def missing(self) -> NodeId | None:
        """Of the participants that seem alive, one that has said nothing in this ballot; None if all have."""
        there = {fact.member.node for fact in self.proposal.facts}
        return min((self.case.participants.nodes & self.case.view.alive) - there, default=None)

    def next_ballot(self) -> Ballot | None:
        """One above all that were met; None if there is none left."""
        met = self.proposal.met
        return next_ballot(self.case.me, (self.case.slot.promised, NO_BALLOT if met is None else met))

    def take(self, sender: NodeId, message: Answer) -> None:
        """Collect what an answer of the present ballot brings; its sender is waited for no more."""
        proposal, case = self.proposal, self.case
        assert proposal.id is not None
        digest = NO_DIGEST if proposal.id.phase is Phase.PREPARE or proposal.chosen is None else proposal.chosen.digest
        new = true_facts(message.facts, proposal.id, digest, case.setting.genesis, case.participants)
        facts = merged(proposal.facts, new)
        arms = proposal.arms - {sender} if len(facts) < len(case.participants.everyone) else frozenset[NodeId]()
        values, highest = proposal.values, None if isinstance(message, Rejected) else message.highest
        is_named = highest is not None and any(
            isinstance(fact, Promise) and fact.accepted != NO_BALLOT and fact.digest == highest.digest for fact in facts
        )
        if highest is not None and is_named and highest not in values and case.state.judge.refuses(highest) is None:
            # Who hands it on may have left out or changed what the digest holds at second hand.
            values = (*values, highest)
        self.change(facts=facts, arms=arms, values=values)
        if isinstance(message, Rejected) and message.refusal.proposal == proposal.id:
            said = message.refusal
            self.refusal = said if is_true(said, case.setting.genesis, case.participants) else None

    def lose(self, node: NodeId) -> bool:
        """Nothing comes back by way of this node; whether it was the last one that was waited for."""
        if node not in self.proposal.arms:
            return False
        self.change(arms=self.proposal.arms - {node})
        return not self.proposal.arms
