"""Whose places were until a moment ago: what such an owner said may be acted by only now (specs/17-simulation.md, Copies)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from scenefold.base.location import Arc, Location

LATELY_S = 1.0
"""An answer is on its way so long, mostly, and what follows from it becomes durable."""


class Passed:
    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._pieces: deque[tuple[float, Arc, int]] = deque()

    def passes(self, arc: Arc, slot: int) -> None:
        """This is no longer the slot's."""
        self._pieces.append((self._now(), arc, slot))

    def owners_lately(self, location: Location) -> set[int]:
        """Slots whose it was within the last moments."""
        while self._pieces and self._pieces[0][0] < self._now() - LATELY_S:
            self._pieces.popleft()
        return {slot for _, arc, slot in self._pieces if location in arc}
