"""What a service must know before it may speak for a place: four small protocols, kept by line, lease, routing and recovery.

A write is acknowledged, and nothing is called absent, only by a node that owns the place *and* holds an owner lease at
the moment of answering (storage.md, Members and owners). So each answer is checked twice: before the work, to do none in
vain, and after it, since the arc may have been given away or the lease have run out meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason

CANDIDATES_MAX = 3
"""Nodes that one read is forwarded to, one after the other: more than two claim a place only if one of them lies."""
LOOKS_MAX = 3
"""An arc that changes during a look makes it worthless; one that changes all the time is a case for the asker's patience."""


class Holdings(Protocol):
    """This node's part of the line, as it is durable (peer/line)."""

    @property
    def arc(self) -> Arc | None:
        """The same object as long as nothing of it is given or taken; what went and came back is equal, and another object."""
        ...

    def owns(self, location: Location) -> bool: ...

    def writing(self, locations: Sequence[Location], *, anywhere: bool = False) -> AbstractAsyncContextManager[None]:
        """Held around a write. Entering waits while one of the places is frozen; freezing waits for who is inside.

        `anywhere`: also where the store chooses the place; that waits for any piece.
        """
        ...


class Lease(Protocol):
    """The right to speak for what one owns, for a while (peer/lease)."""

    def holds(self) -> bool: ...


class Owners(Protocol):
    """Who owns what, as far as this node knows (peer/routing)."""

    def owner_of(self, location: Location) -> NodeId:
        """Whom to ask first. Refused (16) while nothing is known."""
        ...

    def candidates(self, location: Location) -> Sequence[NodeId]:
        """Whom to ask, one after the other. Refused (16) while nothing is known."""
        ...


class Known(Protocol):
    """What of this node's arc it knows all that was acknowledged there (peer/replication). Else it may have owned the place for a moment only."""

    @property
    def is_quiet(self) -> bool:
        """Whether all of the arc is known, so that nothing need be asked of single places."""
        ...

    def is_known(self, location: Location) -> bool:
        """Look before the store is read: what is known in the end may not have been when it was."""
        ...

    def part_of(self, piece: Arc) -> tuple[Arc, bool]:
        """The part of a piece, from its first place on, that is known as a whole, or not recovered as a whole; and whether it is known."""
        ...

    async def look_up(self, locations: Sequence[Location], until: float) -> None:
        """Find out about those that are not known, as far as it is possible until then (Trio's time)."""
        ...


class AllKnown:
    """For a node that has no place but by being given it."""

    is_quiet = True

    def is_known(self, _location: Location) -> bool:
        return True

    def part_of(self, piece: Arc) -> tuple[Arc, bool]:
        return piece, True

    async def look_up(self, _locations: Sequence[Location], _until: float) -> None:
        return None


def other_owner(owners: Owners, location: Location, me: NodeId) -> NodeId:
    """The other node that owns a place that is not ours; Refused (16) if it is between two owners, or nobody is known."""
    owner = owners.owner_of(location)
    if owner == me:
        raise Refused(RejectReason.NOT_READY, "the place is changing hands")
    return owner


def other_candidates(owners: Owners, location: Location, me: NodeId) -> tuple[NodeId, ...]:
    """The other nodes that may own a place that is not ours; Refused (16) if there are none."""
    found = tuple(node for node in owners.candidates(location) if node != me)
    if not found:
        raise Refused(RejectReason.NOT_READY, "the place is changing hands")
    return found[:CANDIDATES_MAX]


def no_lease() -> Refused:
    """Why a node without a lease says nothing."""
    return Refused(
        RejectReason.NOT_READY,
        "the node holds no lease just now, so it cannot answer for its places",
        remedy="try again in a while; if it lasts, the cluster's voter cannot be reached",
    )


def not_recovered() -> Refused:
    """Why a node says nothing of places whose owner was removed."""
    return Refused(
        RejectReason.NOT_READY,
        "the place's owner was removed, and not all nodes have said yet what they have of it",
        remedy="try again in a while; it takes until all nodes are heard, or removed",
    )


def silent_owner(owner: NodeId) -> Refused:
    return Refused(RejectReason.NOT_READY, f"the owner {address_of(owner)} does not answer")
