"""A record moves at most once in ten seconds (Algorithm 5; specs/17-simulation.md, Laws). Pure.

Fed with the pieces of the line that changed hands by handover. A record that a node took over less than ten seconds ago
must not be with the next one yet. Clocks of nodes may run one percent fast, and that much earlier is not held against them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from scenefold.simulation.history import Place

SETTLING_S = 10.0
RATE_ERROR_MAX = 0.01


@dataclass(frozen=True, slots=True)
class Hurry:
    """A record that moved again too soon."""

    place: Place
    after_s: float


@dataclass(slots=True)
class Moves:
    """When each record was last handed over."""

    _at: dict[Place, float] = field(default_factory=dict)
    count: int = 0

    def slept(self) -> None:
        """All machines have slept for longer than that: by their clocks all has settled."""
        self._at.clear()

    def handed_over(self, places: Iterable[Place], now_s: float) -> list[Hurry]:
        """These records have a new owner. Those of them that had not settled."""
        hurried = []
        for place in places:
            before = self._at.get(place)
            if before is not None and now_s - before < SETTLING_S * (1 - RATE_ERROR_MAX):
                hurried.append(Hurry(place, now_s - before))
            self._at[place] = now_s
            self.count += 1
        return hurried
