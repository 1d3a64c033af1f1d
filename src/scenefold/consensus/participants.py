"""Who decides a position, and how many of them are a majority (specs/25-consensus.md, Terms).

A majority is one of those that the log names, whoever seems alive: two majorities of the same participants always have a
member in common, and what a network looks like from one side of a crack changes nothing about that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.wire import Member


class Checks(Protocol):
    """A public key, as `crypto.PublicKey` is one: two with the same bytes are the same one."""

    def __hash__(self) -> int: ...

    def verify(self, signature: bytes, domain: bytes, message: bytes) -> None:
        """Returns if the signature is good; DamagedData otherwise."""


class Signs(Protocol):
    """A private key, as `crypto.SigningKey` is one. The same message MUST give the same signature (Ed25519 does)."""

    def sign(self, domain: bytes, message: bytes) -> bytes: ...


@dataclass(frozen=True, slots=True)
class Participant:
    member: Member
    key: Checks


@dataclass(frozen=True, slots=True)
class Participants:
    """Those who decide one position. Their order means nothing; here they stand in that of their ids."""

    everyone: tuple[Participant, ...]

    def __post_init__(self) -> None:
        nodes = {participant.member.node for participant in self.everyone}
        if not 1 <= len(self.everyone) <= DECIDERS_MAX or len(nodes) != len(self.everyone):
            raise Refused(RejectReason.ILL_FORMED, f"a log is decided by 1 to {DECIDERS_MAX} nodes, each named once")
        object.__setattr__(self, "everyone", tuple(sorted(self.everyone, key=lambda participant: participant.member.node)))

    @property
    def majority(self) -> int:
        return len(self.everyone) // 2 + 1

    @property
    def nodes(self) -> frozenset[NodeId]:
        return frozenset(participant.member.node for participant in self.everyone)

    @property
    def first(self) -> NodeId:
        """Who may have the first ballot of the position: the one in the middle of their ids."""
        return self.everyone[(len(self.everyone) - 1) // 2].member.node

    def member_of(self, node: NodeId) -> Member | None:
        """The incarnation of a node that takes part; None if none does."""
        return next((participant.member for participant in self.everyone if participant.member.node == node), None)

    def key_of(self, member: Member) -> Checks | None:
        """The key that facts about a participant are signed with; None if this incarnation is none."""
        return next((participant.key for participant in self.everyone if participant.member == member), None)

    def __contains__(self, member: Member) -> bool:
        return self.member_of(member.node) == member

    def joined_by(self, participant: Participant) -> Participants:
        """With one more; Refused if its node takes part already."""
        return Participants((*self.everyone, participant))

    def left_by(self, member: Member) -> Participants:
        """With one fewer; Refused if that one takes no part, or is the last."""
        if member not in self:
            raise Refused(RejectReason.ILL_FORMED, "who takes no part cannot leave")
        return Participants(tuple(participant for participant in self.everyone if participant.member != member))
