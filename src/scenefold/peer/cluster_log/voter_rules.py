"""Who decides the cluster's log once several do, as its records say (specs/15-cluster-log.md, Voters). Pure.

At first the log's key decides, which the founding voter holds. The record by which that node names itself, with incarnation and key, is the
last one of that key; from then on votes decide, and each further record adds or removes one voter at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import VOTERS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Participant, Participants
from scenefold.crypto import node_named
from scenefold.wire import AddParticipant, LogEntry, RemoveParticipant, RevokeNode
from scenefold.wire.enrol_entries import Enrol, Trust
from scenefold.world.roll import card_in

if TYPE_CHECKING:
    from scenefold.peer.cluster_log.registry import Registry


class Council(NamedTuple):
    """Who decides behind a position, at which that has changed."""

    position: int
    voters: Participants


@dataclass(frozen=True, slots=True)
class VoterList:
    """As of one position of the log."""

    nodes: tuple[NodeId, ...] = ()
    """Until voters are named, those of Found; the first of them has the log's key."""
    councils: tuple[Council, ...] = ()
    """All who have decided by votes, oldest first; none as long as the log's key decides."""
    endowed: frozenset[NodeId] = frozenset()
    """To whom the authority's key was sealed when the cluster was made: that lies on their disks, and not in the log."""

    @property
    def deciders(self) -> Participants | None:
        """Who decides the next position by votes; None if the log's key does."""
        return self.councils[-1].voters if self.councils else None

    @property
    def certified_from(self) -> float:
        """Behind this position votes decide: the newest record of the log's key; beyond all positions as long as that decides."""
        return self.councils[0].position if self.councils else math.inf

    @classmethod
    def founded(cls, nodes: tuple[NodeId, ...]) -> VoterList:
        return cls(nodes, (), frozenset(nodes))

    def after(self, registry: Registry, entry: AddParticipant | RemoveParticipant, position: int) -> VoterList:
        """Behind an entry that adds or removes one; Refused if it does not fit."""
        voters = _joined(registry, entry) if isinstance(entry, AddParticipant) else _left(self.deciders, entry)
        nodes = tuple(one.member.node for one in voters.everyone)
        return replace(self, nodes=nodes, councils=(*self.councils, Council(position, voters)))

    def begun_anew(self, name: str) -> VoterList:
        """Behind the enrolment of a node: its disk may be another one."""
        return replace(self, endowed=self.endowed - {node_named(name)})


def check_voters_stay(registry: Registry, entry: LogEntry) -> None:
    """Refused if an entry takes from a voter what it has to have, key or trust: nobody knew whether its votes count. It is removed as a
    voter first."""
    voters = registry.voting.deciders
    node = None if voters is None else _stripped(entry)
    if node is not None and node in registry.voters:
        raise Refused(
            RejectReason.NOT_AUTHORISED,
            f"{address_of(node)} is a voter",
            remedy=f"remove it as a voter first: scenectl cluster remove-voter {address_of(node)}",
        )


def _joined(registry: Registry, entry: AddParticipant) -> Participants:
    node, voters = entry.member.node, registry.voting.deciders
    known = registry.current(node)
    if known is None or known.member != entry.member:
        raise Refused(RejectReason.WRONG_INCARNATION, f"{address_of(node)} is no member under this incarnation, so it cannot vote")
    if known.key.raw != entry.key:
        raise _not_authorised(f"{address_of(node)} votes with the key that it is registered with")
    if registry.is_revoked(node, known.key.key_id):
        raise Refused(RejectReason.KEY_REVOKED, f"the key of {address_of(node)} is revoked")
    if not registry.is_trusted(node):
        raise _not_authorised(f"{address_of(node)} is not trusted, and only who is may vote")
    one = Participant(entry.member, known.key)
    if voters is None:
        if node != registry.voters[0]:
            raise _ill_formed(f"{address_of(registry.voters[0])}, which has decided until now, is the first voter that is named")
        return Participants((one,))
    if voters.member_of(node) is not None:
        raise _ill_formed(f"{address_of(node)} is a voter already")
    if len(voters.everyone) >= VOTERS_MAX:
        raise Refused(
            RejectReason.LIMIT_EXCEEDED,
            f"this cluster has {VOTERS_MAX} voters already",
            remedy="remove one first: scenectl cluster remove-voter",
        )
    return voters.joined_by(one)


def _left(voters: Participants | None, entry: RemoveParticipant) -> Participants:
    node = entry.member.node
    if voters is None or (voters.member_of(node) is not None and len(voters.everyone) == 1):
        raise Refused(
            RejectReason.NOT_AUTHORISED,
            "the last voter stays: nobody could decide anything any more",
            remedy="have another node decide first: scenectl cluster add-voter ADDRESS",
        )
    if voters.member_of(node) is None:
        raise _ill_formed(f"{address_of(node)} is no voter")
    if entry.member not in voters:
        raise Refused(RejectReason.WRONG_INCARNATION, f"this is not the incarnation in which {address_of(node)} votes")
    return voters.left_by(entry.member)


def _stripped(entry: LogEntry) -> NodeId | None:
    """The node whose key or trust this ends; None if it ends nobody's."""
    match entry:
        case RevokeNode(node, _):
            return node
        case Trust(node, is_trusted) if not is_trusted:
            return node
        case Enrol():
            return node_named(card_in(entry.card).name)
        case _:
            return None


def _not_authorised(what: str) -> Refused:
    return Refused(RejectReason.NOT_AUTHORISED, what)


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what)
