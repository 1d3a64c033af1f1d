"""Facts: what a participant says of itself, signed, and true for ever (specs/25-consensus.md, Facts). Their bytes: `wire.facts`.

Who passes facts on can leave some out, and can do nothing else to them; so it does not matter by which way, how late or how often they
arrive, or in whose company.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import TypeVar

from scenefold.base.errors import DamagedData
from scenefold.consensus.participants import Checks, Participants, Signs
from scenefold.wire import Fact, Phase, Promise, ProposalId, Refusal, Vote

__all__ = ["Fact", "Promise", "Refusal", "Vote", "belongs", "is_true", "merged", "signed", "true_facts"]

_REMEMBERED_MAX = 4096
"""Verified facts: a packet brings those again that the one before it brought."""

AnyFact = TypeVar("AnyFact", Promise, Vote, Refusal)


def signed(fact: AnyFact, genesis: bytes, key: Signs) -> AnyFact:
    """The fact with its signature."""
    return replace(fact, signature=key.sign(fact.DOMAIN, fact.signable(genesis)))


def is_true(fact: Promise | Vote | Refusal, genesis: bytes, participants: Participants) -> bool:
    """Whether a participant has signed this."""
    key = participants.key_of(fact.member)
    return key is not None and _verified(fact, genesis, key)


@lru_cache(_REMEMBERED_MAX)
def _verified(fact: Promise | Vote | Refusal, genesis: bytes, key: Checks) -> bool:
    try:
        key.verify(fact.signature, fact.DOMAIN, fact.signable(genesis))
    except DamagedData:
        return False
    return True


def belongs(fact: Fact, proposal: ProposalId, digest: bytes) -> bool:
    """Whether a fact is of this ballot and phase, and a vote for this value. Votes of another ballot are no votes of this one."""
    if (fact.position, fact.ballot) != (proposal.position, proposal.ballot):
        return False
    if proposal.phase is Phase.PREPARE:
        return isinstance(fact, Promise)
    return isinstance(fact, Vote) and fact.digest == digest


def true_facts(facts: Iterable[Fact], proposal: ProposalId, digest: bytes, genesis: bytes, participants: Participants) -> tuple[Fact, ...]:
    """Those of the facts that say something about this ballot, phase and value, and are true. What others say besides is no harm."""
    return tuple(fact for fact in facts if belongs(fact, proposal, digest) and is_true(fact, genesis, participants))


def merged(*groups: Iterable[Fact]) -> tuple[Fact, ...]:
    """All facts, one of each participant, in the order of their ids. They are of one ballot and phase."""
    found = {fact.member: fact for group in reversed(groups) for fact in group}
    return tuple(sorted(found.values(), key=lambda fact: fact.member.node))
