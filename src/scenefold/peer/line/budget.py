"""How many bytes a second moving data may take: a bucket that fills with time, shared by handovers and strays."""

from __future__ import annotations

from scenefold.world import Clock

BURST_S = 1.0
"""What was not used for so long is lost: a burst is at most a second's worth."""


class Budget:
    """`await take(bytes)` before bytes are sent; `charge` where waiting would hold up writers. Debts are waited off."""

    def __init__(self, clock: Clock, bytes_per_s: float) -> None:
        assert bytes_per_s > 0
        self._clock = clock
        self.bytes_per_s = bytes_per_s
        self._room = bytes_per_s * BURST_S
        self._at = clock.now()

    def charge(self, count: int) -> None:
        """Take bytes at once, on credit."""
        now = self._clock.now()
        self._room = min(self.bytes_per_s * BURST_S, self._room + (now - self._at) * self.bytes_per_s)
        self._at = now
        self._room -= count

    async def take(self, count: int) -> None:
        """Take bytes, and wait until they have been earned. More than a burst at once is allowed, and waited for."""
        self.charge(count)
        if self._room < 0:
            await self._clock.sleep(-self._room / self.bytes_per_s)
