"""Who owns which arc of the line, as far as this node knows (thesis B.2; specs/11-peers.md, Routing).

A live view, not a table of its own: who stands where says the cluster's log, how far each one's arc goes it says itself
(the roster keeps the newest word), and of its own arc this node knows exactly. A founder that was not heard yet has
its founding bound. What others said may be old, so two claims can contradict each other for a while; the view is a tiling
all the same: an arc ends at its owner's bound and begins behind the arcs on its left, and behind the last bound the last
owner answers. It only says whom to ask; whoever is asked judges by its own durable arc, and knows better.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.registry import Registry


class Claims(Protocol):
    """What nodes say of their right bounds (Roster)."""

    bounds_version: int

    def right_bounds(self) -> Mapping[NodeId, Location | None]: ...


class Own(Protocol):
    """This node (OwnStatus)."""

    arc: Arc | None

    @property
    def me(self) -> NodeId: ...


@dataclass(frozen=True, slots=True)
class Tiling:
    """Owners along the line with their arcs, which tile it. Empty if nobody is known."""

    owners: tuple[NodeId, ...]
    arcs: tuple[Arc, ...]
    bounds: tuple[Location, ...]


def tiling_of(registry: Registry, claimed: Mapping[NodeId, Location | None], me: NodeId, own: Arc | None) -> Tiling:
    """The line as cut by the bounds that nodes claim, in the order of the log. Pure."""
    bounds: list[tuple[NodeId, Location]] = []
    for node in registry.order:
        if node == me and own is not None:
            bounds = _ending_before(own.first, bounds)
        bound = _bound_of(node, registry, claimed) if node != me else own.last if own is not None else None
        if bound is not None and (not bounds or bound > bounds[-1][1]):
            bounds.append((node, bound))
    if not bounds:
        return Tiling((), (), ())
    bounds[-1] = (bounds[-1][0], LAST)
    arcs, first = [], FIRST
    for _, bound in bounds:
        arcs.append(Arc(first, bound))
        first = bound.next() or LAST
    return Tiling(tuple(node for node, _ in bounds), tuple(arcs), tuple(bound for _, bound in bounds))


def _ending_before(fence: Location, bounds: list[tuple[NodeId, Location]]) -> list[tuple[NodeId, Location]]:
    """What nodes on our left claim, without what is certainly ours."""
    kept = [(node, bound) for node, bound in bounds if bound < fence]
    if len(kept) < len(bounds) and fence != FIRST:
        kept.append((bounds[len(kept)][0], Location.from_number(fence.number - 1)))
    return kept if len(kept) < 2 or kept[-2][1] < kept[-1][1] else kept[:-1]


def _bound_of(node: NodeId, registry: Registry, claimed: Mapping[NodeId, Location | None]) -> Location | None:
    if node in claimed:
        return claimed[node]
    founding = registry.founding_arc(node)
    return None if founding is None else founding.last


class Routing:
    """The view. Cheap to ask again and again: it is made anew only when something has changed."""

    def __init__(self, registry: Callable[[], Registry], claims: Claims, own: Own) -> None:
        self._registry = registry
        self._claims = claims
        self._own = own
        self._made_of: tuple[int, int, Arc | None] | None = None
        self._tiling = Tiling((), (), ())
        self._arcs: dict[NodeId, Arc] = {}

    @property
    def members(self) -> tuple[NodeId, ...]:
        """All nodes on the line from left to right, whether they own something or not."""
        return self._registry().order

    @property
    def owners(self) -> list[tuple[NodeId, Arc]]:
        """The nodes that own something, with their arcs, along the line."""
        tiling = self._current()
        return list(zip(tiling.owners, tiling.arcs, strict=True))

    def owner_of(self, location: Location) -> NodeId:
        """The node to ask for a location; Refused (16) as long as nobody is known."""
        tiling = self._current()
        if not tiling.owners:
            raise Refused(RejectReason.NOT_READY, "this node does not know the other members yet", remedy="try again in a while")
        return tiling.owners[bisect_left(tiling.bounds, location)]

    def arc_of(self, node: NodeId) -> Arc | None:
        """The arc of a node; None if it owns nothing, as far as is known."""
        self._current()
        return self._arcs.get(node)

    def owners_of(self, arc: Arc) -> Iterator[tuple[NodeId, Arc]]:
        """The nodes whose arcs overlap `arc`, each with the piece of it that is theirs, along the line."""
        tiling = self._current()
        for index in range(bisect_left(tiling.bounds, arc.first), len(tiling.owners)):
            piece = tiling.arcs[index].intersection(arc)
            if piece is None:
                return
            yield tiling.owners[index], piece

    def _current(self) -> Tiling:
        registry = self._registry()
        made_of = registry.position, self._claims.bounds_version, self._own.arc
        if made_of != self._made_of:
            self._tiling = tiling_of(registry, self._claims.right_bounds(), self._own.me, self._own.arc)
            self._arcs = dict(zip(self._tiling.owners, self._tiling.arcs, strict=True))
            self._made_of = made_of
        return self._tiling
