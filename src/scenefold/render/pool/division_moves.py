"""The moves of all render pools of a job, each of which moves its own cells (specs/36-render-pools.md, *Moving cells*). Pure."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.partition.division import Division
from scenefold.partition.rules import Rule
from scenefold.partition.running_sample import FIRST_RAYS
from scenefold.render.arrays import F64
from scenefold.render.pool.moves import Moves, Told


class DivisionMoves:
    """Of one attempt of a job. `division` is the newest one."""

    def __init__(
        self, rule: Rule, division: Division, box: F64, geometry: F64, first_rays: int = FIRST_RAYS, before: Sequence[Told] = ()
    ) -> None:
        """box f64[2, 3]: the scene's; geometry f64[m, 2, 3]: boxes of what nodes hold. `before`: what all had told when the division was made."""
        self._division = division
        self._pools = [
            None if len(places) == 1 else Moves(rule, partition, box, geometry, first_rays, before[places.start : places.stop])
            for partition, places in zip(division.pools, division.ranges, strict=True)
        ]
        """Of those that can move."""

    @property
    def division(self) -> Division:
        return self._division

    @division.setter
    def division(self, after: Division) -> None:
        """All nodes have claimed it."""
        self._division = after
        for moves, partition in zip(self._pools, after.pools, strict=True):
            if moves is not None:
                moves.partition = partition

    def is_due(self, told: Sequence[Told]) -> bool:
        """Whether the round of a pool is over."""
        return any(moves is not None and moves.is_due(some) for moves, some in zip(self._pools, self._by_pool(told), strict=True))

    def idle_share(self, told: Sequence[Told]) -> float:
        """The largest of the pools whose rounds are over (`Moves.idle_share`)."""
        due = [
            moves.idle_share(some)
            for moves, some in zip(self._pools, self._by_pool(told), strict=True)
            if moves is not None and moves.is_due(some)
        ]
        return max(due, default=0.0)

    def next(self, told: Sequence[Told]) -> Division:
        """What the rule says of each pool whose round is over, in the next epoch; the division itself if nothing is to move. LocalFault if it is for other nodes."""
        after = list(self._division.pools)
        for pool, (moves, some) in enumerate(zip(self._pools, self._by_pool(told), strict=True)):
            if moves is not None and moves.is_due(some):
                after[pool] = moves.next(some)
        if all(one is before for one, before in zip(after, self._division.pools, strict=True)):
            return self._division
        return Division.of(after, self._division.epoch + 1)

    def _by_pool(self, told: Sequence[Told]) -> list[Sequence[Told]]:
        return [told[places.start : places.stop] for places in self._division.ranges]
