"""Which broadcasts count against the silent: of each member no more than its dice give it (specs/11-peers.md, Roster). Pure.

All N members throw the same dice, so each is the author of one broadcast in N seconds on average. Who speaks more often would
make all others look dead, sooner than they can speak themselves. So each has a store of throws, which fills at this rate: an honest
member now and then throws more often than that, and some of its broadcasts count for nothing, so silence seems shorter than it is.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.ids import NodeId

ROUND_S = 1.0
"""Between two throws of one member's dice (thesis B.2.2)."""
THROWS_MAX = 3
"""Broadcasts of one member that count at once: with three, chance takes one in six from an honest one."""


class Throws:
    """Of each member, how many broadcasts would count now."""

    def __init__(self) -> None:
        self._left: dict[NodeId, tuple[float, float]] = {}

    def take(self, member: NodeId, count: int, now: float) -> bool:
        """Whether a broadcast counts that a member has just sent, of `count` on the line."""
        left, at = self._left.get(member, (THROWS_MAX, now))
        left = min(THROWS_MAX, left + (now - at) / (ROUND_S * count))
        counts = left >= 1
        self._left[member] = (left - counts, now)
        return counts

    def keep(self, is_member: Callable[[NodeId], bool]) -> None:
        """Forget whoever is no member now."""
        self._left = {member: left for member, left in self._left.items() if is_member(member)}
