"""What the line was a moment ago (specs/20-copies.md, Reads): whoever held copies of what nobody owns now may still be asked for them.

Between a node's removal and the moment at which another may answer for what it owned lies the time of a lease. Those who held copies for
it go on answering under its configuration; whom to ask, and by whose configuration, only former tables tell.
"""

from __future__ import annotations

from collections import deque

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.base.placement import Layout
from scenefold.client.table import RoutingTable

FORMER_S = 120.0
"""As long as a gap may last: until leases are over, and what lay there is recovered."""
KEPT_MAX = 8
"""Tables with other bounds: they change one at a time."""


class FormerTables:
    """Of one client."""

    def __init__(self) -> None:
        self._tables: deque[tuple[float, RoutingTable]] = deque(maxlen=KEPT_MAX)
        """Until when each was believed, the latest first."""

    def __bool__(self) -> bool:
        return bool(self._tables)

    def replaced(self, now: float, before: RoutingTable, after: RoutingTable) -> None:
        """From now on another table counts."""
        if not before.is_alike(after):
            self._tables.appendleft((now, before))

    def owners(self, now: float, location: Location) -> set[NodeId]:
        """Who has claimed a place lately, as tables said."""
        return {owner.node_id for table in self._lately(now) for owner in table.claimants(location)}

    def holders(self, now: float, layout: Layout, location: Location, needed: int) -> list[NodeId]:
        """Who held copies for those."""
        tables = [table for table in self._lately(now) if table.claimants(location)]
        return list(dict.fromkeys(node for table in tables for node in table.holders_of(layout, location, needed)))

    def _lately(self, now: float) -> list[RoutingTable]:
        while self._tables and now - self._tables[-1][0] > FORMER_S:
            self._tables.pop()
        return [table for _, table in self._tables]
