"""What has rotted on this node's disk and nobody could give, and who could be asked for it (specs/20-copies.md, Healing).

That all have answered says nothing of others: once the place has other members, as a new owner, somebody among these may have it sound.
Nor will they bring it by themselves, since what is left of a record counts in sums like the record.
"""

from __future__ import annotations

import trio

from scenefold.peer.line.parts import Parts
from scenefold.peer.replication.healing_sources import Sources, sources_of
from scenefold.store import Spot
from scenefold.store.debts import Debt
from scenefold.store.noticing import MET_MAX

KEPT_MAX = MET_MAX
"""Records that are remembered: all that the store does."""
AGAIN_MAX = 256
"""That are asked for again at a time, though nobody else can be asked."""
PAGE = 256
"""Looked at before others get their turn."""


class GivenUp:
    """In the order in which they were given up. Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._asked: dict[Spot, Sources | None] = {}
        self._lost: dict[Spot, Debt] = {}
        """What was owed of it."""

    def __bool__(self) -> bool:
        return bool(self._asked)

    def __len__(self) -> int:
        return len(self._asked)

    def __contains__(self, spot: Spot) -> bool:
        return spot in self._asked

    @property
    def count(self) -> int:
        """Of what this node owns, or holds copies of."""
        self.forget_healed()
        return sum(map(self.is_kept, self._asked))

    def is_kept(self, spot: Spot) -> bool:
        """Whether it was given up, and lies here by right: it is asked for in its own time, however often it is met."""
        return spot in self._asked and (self._asked[spot] is not None or self._parts.keeper.holding.owns(spot.home))

    def who(self, spot: Spot) -> Sources | None:
        """Who could be asked for it now, whatever is owed of it; None: nobody, as for a stray."""
        known = self._parts.scenes.here(spot.place.scene)
        layout = None if known is None else known.layouts.get(spot.place.space)
        return sources_of(self._parts.keeper.copies, layout, spot, (), owns=self._parts.keeper.holding.owns(spot.home))

    async def due(self, *, is_time: bool) -> list[Spot]:
        """What is to be asked for again: what others can be asked for and, if it is time, what was given up the longest time ago."""
        self.forget_healed()
        known = list(self._asked)
        found = dict.fromkeys(known[:AGAIN_MAX] if is_time else ())
        for start in range(0, len(known), PAGE):
            await trio.lowlevel.checkpoint()
            found.update(dict.fromkeys(spot for spot in known[start : start + PAGE] if spot in self._asked and self._has_others(spot)))
        return list(found)

    def _has_others(self, spot: Spot) -> bool:
        """Whether it is no longer up to those who could be asked when it was given up."""
        return self._asked[spot] != self.who(spot)

    def add(self, spot: Spot, asked: Sources | None) -> None:
        """`asked`: who could be asked when that began."""
        if len(self._asked) >= KEPT_MAX:
            self.forget_healed()
        if len(self._asked) < KEPT_MAX:
            self._asked[spot] = asked

    def pop(self, spot: Spot) -> None:
        """It is asked for again. What was owed of it is still known."""
        self._asked.pop(spot, None)

    def forget_healed(self) -> None:
        """Forget also what was deleted."""
        noticed = self._parts.store.noticed
        self._asked = {spot: asked for spot, asked in self._asked.items() if noticed.is_rotten(spot)}
        self._lost = {spot: debt for spot, debt in self._lost.items() if noticed.is_given_up(spot)}

    def lose(self, spot: Spot, debt: Debt | None) -> None:
        """All have answered: what is owed of it is owed no longer from here on (paying.py). Who lacks it is remembered."""
        self._parts.store.noticed.give_up(spot)
        self._lost.pop(spot, None)
        if len(self._lost) >= KEPT_MAX:
            self.forget_healed()
        if debt is not None and len(self._lost) < KEPT_MAX:
            self._lost[spot] = debt

    def debt(self, spot: Spot) -> Debt | None:
        """What was owed of it when all had answered."""
        return self._lost.get(spot) if self._parts.store.noticed.is_given_up(spot) else None
