"""What the fold of the cluster's log keeps of a node: as a member, as one that was removed, as a founder that is awaited."""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.crypto import PublicKey
from scenefold.wire import Member

NO_INCARNATION = bytes(16)
"""Stands for the incarnation of a founder that never registered."""


@dataclass(frozen=True, slots=True)
class Registered:
    """A node that is a member. `position`: of the entry that made it one. `founding`: it took its founding seat."""

    node: NodeId
    incarnation: bytes
    key: PublicKey
    address: str
    position: int
    founding: bool

    @property
    def member(self) -> Member:
        return Member(self.node, self.incarnation)


@dataclass(frozen=True, slots=True)
class Removal:
    """Who was removed, at which position, and why."""

    member: Member
    reason: str
    position: int


@dataclass(frozen=True, slots=True)
class Seat:
    """A founder's place on the line, with the key that may take it."""

    node: NodeId
    key: PublicKey
    address: str
