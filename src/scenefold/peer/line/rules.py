"""Who may hand what to whom, and what a node says of its bound: decisions from holding and registry. Pure.

Specs/12-line.md, Steps (an offer fits) and Adoption. The registry is the fold of the cluster's log; both sides judge by
their own, and the receiver's must be at least as new as the giver's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding
from scenefold.wire import Member


class Standing(Protocol):
    """What is asked of a registry here: who stands where."""

    @property
    def position(self) -> int: ...
    @property
    def order(self) -> tuple[NodeId, ...]: ...

    def is_current(self, member: Member, /) -> bool: ...
    def stands(self, node: NodeId, /) -> bool: ...
    def rank(self, node: NodeId, /) -> int: ...
    def neighbours(self, node: NodeId, /) -> tuple[NodeId | None, NodeId | None]: ...
    def founding_arc(self, node: NodeId, /) -> Arc | None: ...
    def current(self, node: NodeId, /) -> HasMember | None: ...


class HasMember(Protocol):
    @property
    def member(self) -> Member: ...


def neighbour_on(standing: Standing, me: NodeId, side: Side) -> Member:
    """The registered neighbour on that side; Refused if there is none to hand anything to."""
    node = standing.neighbours(me)[0 if side is Side.LEFT else 1] if standing.stands(me) else None
    known = standing.current(node) if node is not None else None
    if known is None:
        raise Refused(RejectReason.OUTSIDE_BOUNDS, f"there is no registered neighbour on the {side}")
    return known.member


def side_of_giver(standing: Standing, me: Member, giver: Member, receiver: Member) -> Side:
    """On which side of us a giver stands that offers something to `receiver`; Refused if it may not."""
    if receiver != me or not standing.is_current(me):
        raise Refused(RejectReason.WRONG_INCARNATION, "the offer is for another incarnation of this node")
    if not standing.is_current(giver):
        raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(giver.node)} is not registered under that incarnation")
    for side, node in zip(Side, standing.neighbours(me.node), strict=True):
        if node == giver.node:
            return side
    raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(giver.node)} is no neighbour of this node in the log")


@dataclass(frozen=True, slots=True)
class Bound:
    """A node's durable right bound (None: it is empty), if nothing is on its way there, and its holding's revision."""

    right_bound: Location | None
    revision: int
    is_open: bool = False


def bound_for(holding: Holding, standing: Standing, me: Member, asker: Member, position: int) -> Bound:
    """What we tell another node of our bound; Refused unless both of us stand at the same position of the log.

    The holding must have dropped its handovers with peers that are removed at this position.
    """
    if standing.position != position:
        raise Refused(RejectReason.POSITION_BEHIND, f"the log is at {standing.position} here, not at {position}")
    if not standing.is_current(me):
        raise Refused(RejectReason.WRONG_INCARNATION, "this node is not registered under its incarnation")
    if not standing.is_current(asker):
        raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(asker.node)} is not registered under that incarnation")
    side = Side.RIGHT if standing.rank(asker.node) > standing.rank(me.node) else Side.LEFT
    return Bound(None if holding.arc is None else holding.arc.last, holding.revision, holding.is_open(side))
