"""The timers of one log. Each is set for a time that is drawn, and one that is set again is one timer."""

from __future__ import annotations

import math
from collections.abc import Collection

from scenefold.consensus import Timer, Waits
from scenefold.wire import ProposalId
from scenefold.world import Clock, Entropy


class Timers:
    def __init__(self, clock: Clock, entropy: Entropy) -> None:
        self._clock, self._entropy = clock, entropy
        self._due_at: dict[Timer, float] = {}

    def set(self, timer: Timer, least_s: float, most_s: float) -> None:
        """It goes off after a time between these."""
        self._due_at[timer] = self._clock.now() + least_s + (most_s - least_s) * self._entropy.uniform()

    def forget_hops(self, remembered: Collection[ProposalId]) -> None:
        """Those of proposals that are not remembered any more: so there are never many."""
        self._due_at = {timer: at for timer, at in self._due_at.items() if timer.waits is not Waits.HOP or timer.proposal in remembered}

    def take(self) -> Timer | None:
        """One whose time is over, the earliest first."""
        if self.wait_s() > 0:
            return None
        timer = min(self._due_at, key=self._due_at.__getitem__)
        del self._due_at[timer]
        return timer

    def wait_s(self) -> float:
        """Until the next one goes off."""
        return max(0.0, min(self._due_at.values(), default=math.inf) - self._clock.now())
