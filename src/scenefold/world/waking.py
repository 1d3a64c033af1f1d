"""Sleeping by the world's clock, which goes on while the machine sleeps, as Trio's deadlines do not."""

from __future__ import annotations

from scenefold.world.ports import Clock

LOOK_S = 1.0
"""So late somebody is at most who wakes with his machine."""
LOOK_S_MIN = 0.001
"""Never for so little that no clock moves."""


async def sleep_until(clock: Clock, at: float) -> None:
    """Return once `clock.now()` is at `at` or past it: on waking it may be long past."""
    while (left_s := at - clock.now()) > 0.0:
        await clock.sleep(max(LOOK_S_MIN, min(left_s, LOOK_S)))
