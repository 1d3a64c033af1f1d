"""Facts: what a participant says of itself, signed, and true for ever (specs/25-consensus.md, Facts; specs/26-modes.md, The switch).

    promise  =  genesis 32 | position u64 | ballot 8 | accepted ballot 8 | accepted digest 32 | node u32 | incarnation 16
    vote     =  genesis 32 | position u64 | ballot 8 | digest 32 | node u32 | incarnation 16
    refusal  =  genesis 32 | position u64 | ballot 8 | phase u8 | reason u8 | hint 8 | node u32 | incarnation 16
    release  =  genesis 32 | position u64 | node u32 | incarnation 16

Each is signed under a domain of its own, so that none can be taken for another.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

from scenefold.base.limits import DECIDERS_MAX, PARTICIPANTS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire.ballots import BALLOT, PROPOSAL_ID, Ballot, ProposalId
from scenefold.wire.common import DIGEST, REASON, U64
from scenefold.wire.containers import Many, Struct, Tagged
from scenefold.wire.kinds import Bin
from scenefold.wire.members import MEMBER, Member

_PLACE = struct.Struct(">32sQ")
_BALLOT = struct.Struct(">II")
_MEMBER = struct.Struct(">I16s")


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

    def signable(self, genesis: bytes) -> bytes:
        """What the signature signs, under the domain."""
        return _placed(genesis, self.position, self.ballot) + _packed(self.accepted) + self.digest + _who(self.member)


@dataclass(frozen=True, slots=True)
class Vote:
    """ "I have voted for this value in this ballot." """

    DOMAIN: ClassVar[bytes] = b"scenefold/vote"
    position: int
    ballot: Ballot
    digest: bytes
    member: Member
    signature: bytes = b""

    def signable(self, genesis: bytes) -> bytes:
        """Likewise."""
        return _placed(genesis, self.position, self.ballot) + self.digest + _who(self.member)


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

    def signable(self, genesis: bytes) -> bytes:
        """Likewise."""
        said = bytes((self.proposal.phase, self.reason)) + _packed(self.hint)
        return _placed(genesis, self.proposal.position, self.proposal.ballot) + said + _who(self.member)


@dataclass(frozen=True, slots=True)
class Release:
    """ "I use no lease of a position below this one, and shall use none." """

    DOMAIN: ClassVar[bytes] = b"scenefold/release"
    position: int
    member: Member
    signature: bytes = b""

    def signable(self, genesis: bytes) -> bytes:
        """Likewise."""
        return _PLACE.pack(genesis, self.position) + _who(self.member)


Fact: TypeAlias = Promise | Vote

_SIGNATURE = Bin(lengths=(64,))
PROMISE = Struct(
    Promise,
    ("position", U64),
    ("ballot", BALLOT),
    ("accepted", BALLOT),
    ("digest", DIGEST),
    ("member", MEMBER),
    ("signature", _SIGNATURE),
)
VOTE = Struct(Vote, ("position", U64), ("ballot", BALLOT), ("digest", DIGEST), ("member", MEMBER), ("signature", _SIGNATURE))
REFUSAL = Struct(
    Refusal,
    ("proposal", PROPOSAL_ID),
    ("reason", REASON),
    ("hint", BALLOT),
    ("member", MEMBER),
    ("signature", _SIGNATURE),
)
RELEASE = Struct(Release, ("position", U64), ("member", MEMBER), ("signature", _SIGNATURE))
FACT: Tagged[Fact] = Tagged("Fact", {1: PROMISE, 2: VOTE})
FACTS = Many(FACT, DECIDERS_MAX)
VOTES = Many(VOTE, DECIDERS_MAX)
RELEASES = Many(RELEASE, DECIDERS_MAX + PARTICIPANTS_MAX)
STRUCTS = (PROMISE, VOTE, REFUSAL, RELEASE)


def _placed(genesis: bytes, position: int, ballot: Ballot) -> bytes:
    return _PLACE.pack(genesis, position) + _packed(ballot)


def _packed(ballot: Ballot) -> bytes:
    return _BALLOT.pack(ballot.counter, ballot.node)


def _who(member: Member) -> bytes:
    return _MEMBER.pack(member.node, member.incarnation)
