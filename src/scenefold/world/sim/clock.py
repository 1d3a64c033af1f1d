"""The clock of a simulated machine (port `Clock`): virtual time with an offset and an error of its own.

The offset is drawn from the seed, so that who compares the clocks of two nodes notices. Deadlines are Trio's own and run
on true virtual time; what a node measures and how long it sleeps goes by its clock.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import trio

from scenefold.world.sim.time import current_time_of_simulation

OFFSET_S_MAX = 1e6
WALL_BEGIN = 1.8e9
WALL_ERROR_S_MAX = 300.0


class SimClock:
    """One per machine; goes on while the machine's processes come and go, and while it sleeps."""

    def __init__(self, virtual_now: Callable[[], float], dice: Random) -> None:
        self._virtual_now = virtual_now
        self._offset = dice.random() * OFFSET_S_MAX
        self._wall_offset = WALL_BEGIN + (2 * dice.random() - 1) * WALL_ERROR_S_MAX
        self._rate = 1.0
        self._since = 0.0
        self.paused_until: Callable[[], float] = lambda: 0.0

    def set_rate(self, rate: float) -> None:
        """From now on a second of virtual time is `rate` seconds here; 1.001 gains a second in 1,000."""
        assert rate > 0
        now = self._virtual_now()
        self._offset += (now - self._since) * self._rate
        self._since, self._rate = now, rate

    def step_wall(self, seconds: float) -> None:
        """The wall clock is set; it may jump, `now` may not."""
        self._wall_offset += seconds

    def sleep_through(self, seconds: float) -> None:
        """The machine has slept so long: `now` went on, and Trio's clock stood still, so here no time passes at all."""
        assert seconds > 0
        self._offset += seconds
        self._wall_offset += seconds

    def now(self) -> float:
        return self._offset + (self._virtual_now() - self._since) * self._rate

    def wall(self) -> float:
        return self._wall_offset + self._virtual_now()

    @property
    def stopwatch(self) -> None:
        return None

    async def sleep(self, seconds: float) -> None:
        await current_time_of_simulation().sleep(max(0.0, seconds) / self._rate)
        while (end := self.paused_until()) > trio.current_time():  # noqa: ASYNC110 - it may be lengthened meanwhile
            await trio.sleep_until(end)
