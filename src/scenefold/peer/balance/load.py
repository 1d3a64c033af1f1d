"""The fill by which balance goes: what a node owns counts, what it holds for others does not (specs/13-balance.md, Fill).

Who gives a piece away mostly becomes its holder, so its disk stays as full as it was: by that measure bounds would wander for
ever, and draw copies behind them. What a node owns does change with its bounds, and what it holds follows what the others own. Only
where the disk is nearly full all of it counts, else such a node would be given more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.peer.copies.custody import Custody
from scenefold.store.layout import SpaceAddress
from scenefold.store.statistics import Counts, StoreStatistics, capacity_of
from scenefold.store.versions import RangeSum
from scenefold.world import Clock

HELD_COUNTS_FROM, HELD_COUNTS_WHOLE_FROM = 0.8, 0.9
"""Below the first fill of the disk what is held does not count; from the second on, where balance gives nobody anything, all of it;
in between a part, so that a little more on the disk never changes much."""
COUNT_AGAIN_S = 5.0
"""Between two counts in a store that is written to all the time."""
WALKED_RECORDS_MAX = 1 << 15
"""In a store with more the tree of digests says how many records are owned, and of each space an average one is taken: a walk would take
too long. In a smaller one a few large records could make that wrong."""
RECOVERS_S_MAX = 600.0
"""So long what is being recovered keeps balance away. Who has to say what lies there may be unable to until balance has made room."""


class Counted(Protocol):
    """What is asked of the store."""

    async def statistics(self) -> StoreStatistics: ...
    async def arc_totals(self, arc: Arc) -> Counts: ...
    async def sums(self, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]) -> list[RangeSum]: ...


def load_of(used: int, capacity: int, owned: float) -> int:
    """The bytes that count, of those used; `owned`: the share of them that is this node's own."""
    fill = used / capacity if capacity else 1.0
    counts = (fill - HELD_COUNTS_FROM) / (HELD_COUNTS_WHOLE_FROM - HELD_COUNTS_FROM)
    return used - int(used * (1.0 - owned) * (1.0 - min(max(counts, 0.0), 1.0)))


def owned_share(spaces: Mapping[SpaceAddress, Counts], owned: Mapping[SpaceAddress, int]) -> float:
    """The share of all bytes that is owned, if so many records of each space are."""
    total = sum(counts.bytes for counts in spaces.values())
    found = sum(counts.bytes * min(owned.get(space, 0) / counts.records, 1.0) for space, counts in spaces.items() if counts.records)
    return found / total if total else 1.0


class Recovering:
    """Whether a part of the arc has yet to be fetched from others, and has had the time for that. Used from the Trio thread only."""

    def __init__(self, clock: Clock, is_unrecovered: Callable[[], bool]) -> None:
        self._clock = clock
        self._is_unrecovered = is_unrecovered
        self._since: float | None = None

    def __call__(self) -> bool:
        if not self._is_unrecovered():
            self._since = None
            return False
        now = self._clock.now()
        if self._since is None:
            self._since = now
        return now - self._since < RECOVERS_S_MAX


class OwnLoad:
    """This node's fill, looked at once in a while. Used from the Trio thread only."""

    def __init__(
        self,
        clock: Clock,
        store: Counted,
        arc: Callable[[], Arc | None],
        custody: Callable[[], Custody],
        capacity_bytes: int,
        leaves: Callable[[], bool] = lambda: False,
        recovers: Callable[[], bool] = lambda: False,
    ) -> None:
        """`capacity_bytes`: what the node may use of the disk; 0: all of it. `leaves`: whether it takes nothing, since it is leaving.

        `recovers`: whether a part of the arc has yet to be fetched from others.
        """
        self._clock = clock
        self._store = store
        self._arc = arc
        self._custody = custody
        self._capacity_bytes = capacity_bytes
        self._leaves = leaves
        self._recovers = recovers
        self._share = 1.0
        self._share_of = 0
        """The bytes used when that was counted. What has come since may be held for others: it counts from the next time on."""
        self._counted_in: tuple[Arc, bool] | None = None
        self._counted_at = float("-inf")
        self._counted: Mapping[SpaceAddress, Counts] = {}
        """What there was of each space when the share was counted."""
        self._owned: dict[SpaceAddress, int] = {}

    async def look(self) -> tuple[int, int]:
        """The bytes that count, and those that there are, of the disk or of the share of it that the node may use.

        Who leaves has no more than it uses. Else others would count on room that nobody is given, and move bounds to and fro beside it.
        """
        statistics = await self._store.statistics()
        used, capacity = statistics.disk_used_bytes, capacity_of(statistics, self._capacity_bytes)
        # Who holds nothing for others has nothing to count.
        counts = load_of(used, capacity, await self._owned_part(statistics) if self._custody().entries else 1.0)
        return counts, counts if self._leaves() else capacity

    async def _owned_part(self, statistics: StoreStatistics) -> float:
        arc, now = self._arc(), self._clock.now()
        if arc is None:
            return 0.0
        about = arc, self._recovers()
        has_moved = about != self._counted_in
        # A piece that has passed must show at once: balance has counted it at both ends already.
        if has_moved or (statistics.spaces != self._counted and now >= self._counted_at + COUNT_AGAIN_S):
            try:
                self._share = await self._counted_share(statistics, arc, has_moved=has_moved)
            except Refused:
                # A tree is damaged, and the full disk has no room to make it anew: there all that is used counts anyway.
                return self._share
            self._counted_in, self._counted_at, self._counted = about, now, statistics.spaces
            self._share_of = statistics.disk_used_bytes
        return self._share * min(1.0, self._share_of / max(1, statistics.disk_used_bytes))

    async def _counted_share(self, statistics: StoreStatistics, arc: Arc, *, has_moved: bool) -> float:
        if statistics.records <= WALKED_RECORDS_MAX:
            self._owned = {}
            totals = await self._store.arc_totals(arc)
            # Something may have been written since the look at the statistics.
            return min(totals.bytes / statistics.bytes, 1.0) if statistics.bytes else 1.0
        known = {} if has_moved else self._owned
        owned = {}
        for space, counts in statistics.spaces.items():
            if space in known and counts == self._counted.get(space):
                owned[space] = known[space]
            else:
                owned[space] = (await self._store.sums(*space, [arc]))[0].records
        self._owned = owned
        return owned_share(statistics.spaces, owned)
