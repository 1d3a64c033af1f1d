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
    right_bound: Location
    lamport: int = 0


class RoutingTable:
    """An unchanging table; `updated` makes a new one. At least one owner."""

    def __init__(self, owners: Iterable[Owner]) -> None:
        self.owners: Sequence[Owner] = tuple(sorted(owners, key=lambda owner: (owner.right_bound, owner.node_id)))
        assert self.owners, "a routing table needs an owner"
        self._bounds = [owner.right_bound for owner in self.owners]
        self._by_id = {owner.node_id: owner for owner in self.owners}

    def owner_of(self, location: Location) -> Owner:
        """The node whose arc holds the location; behind the last bound it is the last node."""
        return self.owners[min(bisect_left(self._bounds, location), len(self.owners) - 1)]

    def by_id(self, node_id: NodeId) -> Owner | None:
        return self._by_id.get(node_id)

    def arcs(self) -> list[tuple[Owner, Arc]]:
        """Every owner with its arc, in the order of the line. Owners of nothing (equal bounds) are left out."""
        found, first = [], FIRST
        for index, owner in enumerate(self.owners):
            last = LAST if index == len(self.owners) - 1 else owner.right_bound
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
