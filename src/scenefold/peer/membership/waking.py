"""Since when this machine is awake: nobody can have been heard before.

The world's clock goes on while a machine sleeps, Trio's stands still (world/ports.py). Where the two come apart, it has slept. Machines that
sleep together, as the nodes of a laptop that is shut, or all computers of a room by night, would else find on waking that all others have
been silent for hours, and remove whoever is not the first to speak.
"""

from __future__ import annotations

import math

import trio

from scenefold.world import Clock

SLEPT_S_MIN = 5.0
"""Further apart between two looks, than clocks of different rates ever come."""


class Waking:
    """To be looked at once in a while: every few seconds, and before what it says is used."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._apart: float | None = None
        self._since = -math.inf

    def since(self) -> float:
        """By the world's clock; -inf if it has not slept yet."""
        now = self._clock.now()
        apart = now - trio.current_time()
        if self._apart is not None and apart - self._apart > SLEPT_S_MIN:
            self._since = now
        self._apart = apart
        return self._since
