"""Who owns what, as the client knows it: arcs that all nodes claim, looked up by location (storage.md, *The line*).

A client is no member: it asks a node for the table and keeps it fresh from the MiniStatus on every reply. What nodes say of
their arcs is of different moments, so two may claim a place; then there is a second one to ask. The table may be old; then the
node that is asked says so (reasons 7 and 10), and the table is asked for again. So nothing here must be right for data to be
right, only for it to be fast.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace

from scenefold.base.cover import Cover, runs
from scenefold.base.ids import NodeId
from scenefold.base.location import LAST, Arc, Location
from scenefold.base.placement import Holders, Layout, Line, holders_at
from scenefold.base.prefixes import AddressPrefix, forbids


@dataclass(frozen=True, slots=True)
class Owner:
    """A node with the arc that it claims; a higher lamport is newer news of it."""

    node_id: NodeId
    address: str
    right_bound: Location | None
    """None: it owns nothing."""
    lamport: int = 0
    first: Location | None = None
    """Where the arc begins; None if that is not known: behind whatever is claimed on its left."""
    blacklist: tuple[AddressPrefix, ...] = ()
    """Which nodes hold no copies of what it owns."""

    def may_be_held_by(self, node: NodeId) -> bool:
        """Whether a node may hold copies of what this one owns."""
        return not forbids(self.blacklist, node, owner=self.node_id)

    @property
    def claim(self) -> Arc | None:
        if self.right_bound is None:
            return None
        return Arc(self.right_bound if self.first is None else min(self.first, self.right_bound), self.right_bound)


class RoutingTable:
    """An unchanging table; `updated` makes a new one. At least one owner."""

    def __init__(self, owners: Iterable[Owner]) -> None:
        self._by_id = {owner.node_id: owner for owner in owners}
        nodes = [self._by_id[node_id] for node_id in sorted(self._by_id)]
        bounds = sorted((owner.right_bound, owner.node_id) for owner in nodes if owner.right_bound is not None)
        owning = [self._by_id[node_id] for _, node_id in bounds]
        self._cover = Cover([(claim, owner) for owner in owning if (claim := owner.claim) is not None])
        self._arcs = runs([(arc, held[0]) for arc, held in self._cover.stretches() if held])
        self._ends = [arc.last for arc, _ in self._arcs]
        self.owners: Sequence[Owner] = (*owning, *(owner for owner in nodes if owner.right_bound is None))
        """All nodes: first those that own something, in the order of the line."""
        self._line: Line | None = None
        """Made when it is first asked for: most tables are not."""
        assert self.owners, "a routing table needs a node"

    def candidates(self, location: Location) -> tuple[Owner, ...]:
        """The nodes to ask for a location: those that claim it; else those beside the gap, the right one first.

        If nobody owns anything, as in a cluster that begins, it is any node: it knows better.
        """
        return self._cover.at(location) or (self.owners[0],)

    def claimants(self, location: Location) -> tuple[Owner, ...]:
        """The nodes that claim a location; nobody in a gap."""
        return () if self._cover.is_gap(location) else self._cover.at(location)

    def is_alike(self, other: RoutingTable) -> bool:
        """Whether both say the same of who owns what."""
        return self._cover is other._cover or self._claims() == other._claims()

    def _claims(self) -> list[tuple[NodeId, Arc | None]]:
        return [(owner.node_id, owner.claim) for owner in self.owners]

    def owner_of(self, location: Location) -> Owner:
        """The first of the candidates."""
        return self.candidates(location)[0]

    def end_of(self, location: Location) -> Location:
        """The last location from there on that has the same first candidate."""
        return self._ends[bisect_left(self._ends, location)] if self._ends else LAST

    def holders_of(self, layout: Layout, location: Location, needed: int = 1) -> Holders:
        """Who should hold the copies of a place, by this table (specs/20-copies.md, Placement). `needed`: of these and the owner for a write."""
        if self._line is None:
            self._line = Line((owner.node_id, owner.claim) for owner in self.owners)
        owner = self.owner_of(location)
        forbidden = [node for node in self._by_id if not owner.may_be_held_by(node)]
        return holders_at(self._line, owner.node_id, forbidden, layout, location, needed - 1)

    def beside(self, node_id: NodeId) -> list[NodeId]:
        """Who owns what lies beside a node's arc; nobody if it has none."""
        owning = [owner.node_id for owner in self.owners if owner.right_bound is not None]
        if node_id not in owning:
            return []
        place = owning.index(node_id)
        return list(dict.fromkeys(owning[(place + step) % len(owning)] for step in (-1, 1)))

    def by_id(self, node_id: NodeId) -> Owner | None:
        return self._by_id.get(node_id)

    def arcs(self) -> list[tuple[Owner, Arc]]:
        """The line in order, each stretch with its first candidate. Empty if nobody owns anything."""
        return [(owner, arc) for arc, owner in self._arcs]

    def updated(self, news: Owner) -> RoutingTable:
        """The table with newer news of one node's bound; itself if it knows as much already."""
        known = self._by_id.get(news.node_id)
        if known is not None and known.lamport >= news.lamport:
            return self
        if known is not None and known.right_bound == news.right_bound:
            return self._confirmed(replace(known, lamport=news.lamport))
        return RoutingTable([owner for node, owner in self._by_id.items() if node != news.node_id] + [news])

    def _confirmed(self, owner: Owner) -> RoutingTable:
        """The table that knows of the same bounds that one of them is newer: what is older than that cannot change it any more.

        Each reply brings such news, so the cover of the line is not made again; the owners in it keep the times they had.
        """
        table = copy(self)
        table._by_id = {**self._by_id, owner.node_id: owner}
        return table
