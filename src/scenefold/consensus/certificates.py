"""Certificates: votes of a majority in one ballot, which show that a value is decided, whoever brings them (specs/25-consensus.md, Terms)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from scenefold.consensus.facts import Fact, Vote, belongs, merged, true_facts
from scenefold.consensus.participants import Participants
from scenefold.consensus.values import Value
from scenefold.wire import Ballot, Phase, ProposalId


@dataclass(frozen=True, slots=True)
class Certificate:
    position: int
    ballot: Ballot
    votes: tuple[Vote, ...]

    def proves(self, value: Value, genesis: bytes, participants: Participants) -> bool:
        """Whether the value is decided, by those who decide this position."""
        proposal = ProposalId(self.position, self.ballot, Phase.ACCEPT)
        return len(merged(true_facts(self.votes, proposal, value.digest, genesis, participants))) >= participants.majority


def certificate_of(position: int, ballot: Ballot, digest: bytes, facts: Iterable[Fact], participants: Participants) -> Certificate | None:
    """What these facts, which are true ones, show to be decided; None if they are too few."""
    proposal = ProposalId(position, ballot, Phase.ACCEPT)
    votes = tuple(fact for fact in merged(facts) if isinstance(fact, Vote) and belongs(fact, proposal, digest))
    return Certificate(position, ballot, votes) if len(votes) >= participants.majority else None
