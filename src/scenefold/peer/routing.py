"""Who owns which arc of the line (thesis B.2; specs/11-peers.md, Routing). Pure.

Every registered member owns one arc; arcs tile the line in id order. Today the arcs are even and stand still, and
they don't depend on who is alive: an arc whose owner is away is unavailable, never somebody else's, since two
owners at once is the one thing that must not happen. Moving a bound will replace this value by another, so whoever
routes asks the current `Routing` and never keeps bounds of its own.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location, arcs_between, even_right_bounds


class Routing:
    """The table of members, arcs and right bounds. Immutable."""

    __slots__ = ("_arcs", "_bounds", "_members")

    def __init__(self, members: Iterable[NodeId]) -> None:
        self._members = sorted(set(members))
        self._bounds = even_right_bounds(len(self._members))
        self._arcs = dict(zip(self._members, arcs_between(self._bounds), strict=True))

    @property
    def members(self) -> tuple[NodeId, ...]:
        """All owners in the order of the line."""
        return tuple(self._members)

    def owner_of(self, location: Location) -> NodeId:
        """The one member whose arc holds the location."""
        return self._members[bisect_left(self._bounds, location)]

    def arc_of(self, member: NodeId) -> Arc:
        """The arc of a member; KeyError if it is none."""
        return self._arcs[member]

    def owners_of(self, arc: Arc) -> Iterator[tuple[NodeId, Arc]]:
        """The members whose arcs overlap `arc`, each with the piece of it that is theirs, along the line."""
        for member in self._members[bisect_left(self._bounds, arc.first) :]:
            piece = self._arcs[member].intersection(arc)
            if piece is None:
                return
            yield member, piece
