"""Who owns what, as the client knows it: right bounds of all nodes, looked up by location (storage.md, *The line*).

A client is no member: it asks a node for the table and keeps it fresh from the MiniStatus on every reply. Its
table may be old; then the node that it asks says who owns the location (reason 10), and the table is asked
for again. So nothing here must be right for data to be right, only for it to be fast.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, Arc, Location


@dataclass(frozen=True, slots=True)
class Owner:
    """A node with the last location that it owns; a higher lamport is newer news of it."""

    node_id: NodeId
    address: str
    right_bound: Location | None
    """None: it owns nothing."""
    lamport: int = 0


class RoutingTable:
    """An unchanging table; `updated` makes a new one. At least one owner."""

    def __init__(self, owners: Iterable[Owner]) -> None:
        self._by_id = {owner.node_id: owner for owner in owners}
        nodes = [self._by_id[node_id] for node_id in sorted(self._by_id)]
        bounds = sorted((owner.right_bound, owner.node_id) for owner in nodes if owner.right_bound is not None)
        self._bounds = [bound for bound, _ in bounds]
        self._owning = [self._by_id[node_id] for _, node_id in bounds]
        self.owners: Sequence[Owner] = (*self._owning, *(owner for owner in nodes if owner.right_bound is None))
        """All nodes: first those that own something, in the order of the line."""
        assert self.owners, "a routing table needs a node"

    def owner_of(self, location: Location) -> Owner:
        """The node whose arc holds the location; behind the last bound it is the last node that owns anything.

        If none does, as in a cluster that begins, it is any node: it knows better.
        """
        owning = self._owning or self.owners
        return owning[min(bisect_left(self._bounds, location), len(owning) - 1)]

    def holder_of(self, location: Location) -> tuple[Owner, Location]:
        """The owner of a location, and the last location from there on that is its, too."""
        owner = self.owner_of(location)
        bound = owner.right_bound
        return owner, LAST if bound is None or owner is self._owning[-1] else bound

    def by_id(self, node_id: NodeId) -> Owner | None:
        return self._by_id.get(node_id)

    def arcs(self) -> list[tuple[Owner, Arc]]:
        """Every owner with its arc, in the order of the line. Owners of nothing are left out."""
        found, first = [], FIRST
        for index, (owner, bound) in enumerate(zip(self._owning, self._bounds, strict=True)):
            last = LAST if index == len(self._owning) - 1 else bound
            if last >= first:
                found.append((owner, Arc(first, last)))
                following = last.next()
                if following is None:
                    break
                first = following
        return found

    def updated(self, news: Owner) -> RoutingTable:
        """The table with newer news of one node; itself if it knows as much already."""
        known = self._by_id.get(news.node_id)
        if known is not None and known.lamport >= news.lamport:
            return self
        if known is not None and known.right_bound == news.right_bound:
            return self
        return RoutingTable([owner for owner in self.owners if owner.node_id != news.node_id] + [news])
