"""What the fold of the cluster's log keeps of a node: as a member, as one that was removed, as a founder that is awaited; and of a request."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import NODES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey, SealingPublicKey
from scenefold.wire import LogEntry, LogRecord, Member
from scenefold.wire.log_records import hash_of_entry

NO_INCARNATION = bytes(16)
"""Stands for the incarnation of a founder that never registered."""
DRAINED = "drained"
"""Why a node is removed that has handed over all that it had."""


@dataclass(frozen=True, slots=True)
class Registered:
    """A node that is a member. `position`: of the entry that made it one. `founding`: it took its founding seat."""

    node: NodeId
    incarnation: bytes
    key: PublicKey
    sealing_key: SealingPublicKey
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

    @property
    def is_loss(self) -> bool:
        """Whether what only this incarnation's disk had is gone with it."""
        return self.reason != DRAINED


@dataclass(frozen=True, slots=True)
class Seat:
    """A founder's place on the line, with the keys that may take it."""

    node: NodeId
    key: PublicKey
    sealing_key: SealingPublicKey
    address: str


@dataclass(frozen=True, slots=True)
class Committed:
    """A request that is in the log: where, the record's hash, and that of what it says."""

    position: int
    record_hash: bytes
    entry_hash: bytes

    def of(self, entry: LogEntry) -> int:
        """Where this was committed. Refused if something else was, under the same id: ids are seen by who carries a request, and whoever
        has one of its own committed under another's id must not have that taken for done.
        """
        if hash_of_entry(entry) != self.entry_hash:
            raise Refused(
                RejectReason.ILL_FORMED, f"another entry has this request's id, at position {self.position}", remedy="give it once more"
            )
        return self.position


@lru_cache(maxsize=2 * NODES_MAX)
def committed(record: LogRecord) -> Committed:
    return Committed(record.position, record.hash(), hash_of_entry(record.entry))


@lru_cache(maxsize=2 * NODES_MAX)
def signing_key_from(raw: bytes) -> PublicKey:
    # Remembered, since every fold of the same log, and every node of a simulation, meets the same keys.
    try:
        return PublicKey(raw)
    except DamagedData as problem:
        raise _ill_formed(str(problem)) from problem


@lru_cache(maxsize=2 * NODES_MAX)
def sealing_key_from(raw: bytes) -> SealingPublicKey:
    try:
        return SealingPublicKey(raw)
    except DamagedData as problem:
        raise _ill_formed(str(problem)) from problem


def check_address(node: NodeId, address: str) -> None:
    # Ids are addresses for now, and links are opened by id: another address would be announced and never be dialled.
    if address != address_of(node):
        raise _ill_formed(f"node {node} is at {address_of(node)}, not at {address}")


def inserted(order: tuple[NodeId, ...], node: NodeId, left_of: NodeId) -> tuple[NodeId, ...]:
    """The line with one more node on it, directly left of another one."""
    if node in order:
        raise _ill_formed(f"{address_of(node)} has a founding seat and takes that")
    if left_of not in order:
        raise _ill_formed(f"{address_of(left_of)}, which the node would stand left of, is not on the line")
    if len(order) >= NODES_MAX:
        raise Refused(RejectReason.LIMIT_EXCEEDED, f"this cluster has {NODES_MAX} nodes already")
    rank = order.index(left_of)
    return (*order[:rank], node, *order[rank:])


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what)
