"""Whom to ask for which place of the line, as far as this node knows (thesis B.2; specs/11-peers.md, Routing).

A live view, not a table of its own: how far each one's arc goes it says itself (the roster keeps the newest word), and of its
own arc this node knows exactly. A founder that was not heard yet has its founding arc. What others said may be old, so for a
while two may claim a place, or nobody. Which of two is right cannot be told, since pieces move both ways: both are candidates,
who is believed alive and has spoken last first. It only says whom to ask; whoever is asked judges by its own durable arc.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from scenefold.base.cover import Cover, runs, without
from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.registry import Registry


class Claims(Protocol):
    """What nodes say of their arcs, and whether they seem alive (Roster)."""

    arcs_version: int

    def arcs(self) -> Mapping[NodeId, Arc | None]: ...

    def said_at(self, member: NodeId) -> float: ...

    def is_believed_alive(self, member: NodeId) -> bool: ...


class Own(Protocol):
    """This node (OwnStatus)."""

    arc: Arc | None

    @property
    def me(self) -> NodeId: ...


def claims_of(registry: Registry, said: Mapping[NodeId, Arc | None], me: NodeId, own: Arc | None) -> list[tuple[Arc, NodeId]]:
    """Every claim, in the order of the log, without what is certainly ours. Pure."""
    claims: list[tuple[Arc, NodeId]] = []
    for node in registry.order:
        if node == me:
            claims += [] if own is None else [(own, me)]
        elif (arc := said[node] if node in said else registry.founding_arc(node)) is not None:
            claims += [(rest, node) for rest in without(arc, own)]
    return claims


class Routing:
    """The view. Cheap to ask again and again: it is made anew only when a claim has changed."""

    def __init__(self, registry: Callable[[], Registry], claims: Claims, own: Own) -> None:
        self._registry = registry
        self._claims = claims
        self._own = own
        self._made_of: tuple[int, int, Arc | None] | None = None
        self._cover = Cover[NodeId]([])
        self._arcs: dict[NodeId, Arc] | None = None

    @property
    def members(self) -> tuple[NodeId, ...]:
        """All nodes on the line from left to right, whether they own something or not."""
        return self._registry().order

    @property
    def owners(self) -> list[tuple[NodeId, Arc]]:
        """The line from left to right, each stretch with whom we would ask for it first. Empty if nobody is known."""
        asked = [(arc, self.candidates(arc.first)[0]) for arc, held in self._current().stretches() if held]
        return [(node, arc) for arc, node in runs(asked)]

    def candidates(self, location: Location) -> Sequence[NodeId]:
        """The nodes to ask for a location, one after the other until one has it; Refused (16) as long as nobody is known."""
        cover = self._current()
        held = cover.at(location)
        if not held:
            raise Refused(RejectReason.NOT_READY, "this node does not know the other members yet", remedy="try again in a while")
        return held if len(held) == 1 else self._in_order(held, are_claimants=not cover.is_gap(location))

    def owner_of(self, location: Location) -> NodeId:
        """The first of the candidates."""
        return self.candidates(location)[0]

    def arc_of(self, node: NodeId) -> Arc | None:
        """The longest stretch for which we would ask a node first; None if there is none."""
        self._current()
        if self._arcs is None:
            self._arcs = {}
            for owner, arc in self.owners:
                if owner not in self._arcs or arc.length > self._arcs[owner].length:
                    self._arcs[owner] = arc
        return self._arcs.get(node)

    def _in_order(self, held: Sequence[NodeId], *, are_claimants: bool) -> Sequence[NodeId]:
        me, claims = self._own.me, self._claims

        def last(node: NodeId) -> tuple[bool, bool, float]:
            # What is ours we know, and nobody else stands here then: beside a gap we are the last to ask.
            return node == me, not claims.is_believed_alive(node), -claims.said_at(node) if are_claimants else 0.0

        return sorted(held, key=last)

    def _current(self) -> Cover[NodeId]:
        registry = self._registry()
        made_of = registry.position, self._claims.arcs_version, self._own.arc
        if made_of != self._made_of:
            self._cover = Cover(claims_of(registry, self._claims.arcs(), self._own.me, self._own.arc))
            self._arcs = None
            self._made_of = made_of
        return self._cover
