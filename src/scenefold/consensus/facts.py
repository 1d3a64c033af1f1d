"""Facts: what a participant says of itself, signed, and true for ever (specs/25-consensus.md, Facts).

    promise  =  genesis 32 | position u64 | ballot 8 | accepted ballot 8 | accepted digest 32 | node u32 | incarnation 16
    vote     =  genesis 32 | position u64 | ballot 8 | digest 32 | node u32 | incarnation 16
    refusal  =  genesis 32 | position u64 | ballot 8 | phase u8 | reason u8 | hint 8 | node u32 | incarnation 16

Each is signed under a domain of its own, so that none can be taken for another. Who passes facts on can leave some out, and
can do nothing else to them; so it does not matter by which way, how late or how often they arrive, or in whose company.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, TypeVar

from scenefold.base.errors import DamagedData
from scenefold.base.reasons import RejectReason
from scenefold.consensus.participants import Checks, Participants, Signs
from scenefold.wire import Ballot, Member, Phase, ProposalId

_HEAD = struct.Struct(">32sQII")
_BALLOT = struct.Struct(">II")
_MEMBER = struct.Struct(">I16s")
_REMEMBERED_MAX = 4096
"""Verified facts: a packet brings those again that the one before it brought."""


@dataclass(frozen=True, slots=True)
class Promise:
    """ "I take part in no lower ballot at this position, and the newest that I have voted in there is this." """

    DOMAIN: ClassVar[bytes] = b"scenefold/promise"
    position: int
    ballot: Ballot
    accepted: Ballot
    digest: bytes
    """Of the value that it voted for in `accepted`; zero if it voted in none."""
    member: Member
    signature: bytes = b""


@dataclass(frozen=True, slots=True)
class Vote:
    """ "I have voted for this value in this ballot." """

    DOMAIN: ClassVar[bytes] = b"scenefold/vote"
    position: int
    ballot: Ballot
    digest: bytes
    member: Member
    signature: bytes = b""


@dataclass(frozen=True, slots=True)
class Refusal:
    """ "I have refused this ballot in this phase, and what I had promised then was the hint." Signed, so that nobody but a
    participant can end a proposal by it, or drive ballots to where there are no more."""

    DOMAIN: ClassVar[bytes] = b"scenefold/refusal"
    proposal: ProposalId
    reason: RejectReason
    hint: Ballot
    member: Member
    signature: bytes = b""


Fact = Promise | Vote
AnyFact = TypeVar("AnyFact", Promise, Vote, Refusal)


def message_of(fact: Promise | Vote | Refusal, genesis: bytes) -> bytes:
    """The bytes that are signed."""
    member = _MEMBER.pack(fact.member.node, fact.member.incarnation)
    match fact:
        case Promise(position, ballot, accepted, digest):
            middle = _BALLOT.pack(accepted.counter, accepted.node) + digest
        case Vote(position, ballot, digest):
            middle = digest
        case Refusal(proposal, reason, hint):
            position, ballot = proposal.position, proposal.ballot
            middle = bytes((proposal.phase, reason)) + _BALLOT.pack(hint.counter, hint.node)
    return _HEAD.pack(genesis, position, ballot.counter, ballot.node) + middle + member


def signed(fact: AnyFact, genesis: bytes, key: Signs) -> AnyFact:
    """The fact with its signature."""
    return replace(fact, signature=key.sign(fact.DOMAIN, message_of(fact, genesis)))


def is_true(fact: Promise | Vote | Refusal, genesis: bytes, participants: Participants) -> bool:
    """Whether a participant has signed this."""
    key = participants.key_of(fact.member)
    return key is not None and _verified(fact, genesis, key)


@lru_cache(_REMEMBERED_MAX)
def _verified(fact: Promise | Vote | Refusal, genesis: bytes, key: Checks) -> bool:
    try:
        key.verify(fact.signature, fact.DOMAIN, message_of(fact, genesis))
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
