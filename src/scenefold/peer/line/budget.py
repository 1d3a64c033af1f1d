"""How many bytes a second moving data may take: a bucket that fills with time, shared by all that moves data."""

from __future__ import annotations

from scenefold.world import Clock

BURST_S = 1.0
"""What was not used for so long is lost: a burst is at most a second's worth."""
LOOK_S = 5.0
"""Who waits for longer looks so often whether the rate is another one by now."""


class Budget:
    """`await take(bytes)` before bytes are sent; `charge` where waiting would hold up writers. Debts are waited off.

    `bytes_per_s` may be set at any time.
    """

    def __init__(self, clock: Clock, bytes_per_s: float) -> None:
        assert bytes_per_s > 0
        self._clock = clock
        self._bytes_per_s = bytes_per_s
        self._room = bytes_per_s * BURST_S
        self._at = clock.now()

    @property
    def bytes_per_s(self) -> float:
        return self._bytes_per_s

    @bytes_per_s.setter
    def bytes_per_s(self, rate: float) -> None:
        assert rate > 0
        # What was earned until now was earned by the rate before.
        self.charge(0)
        self._bytes_per_s = rate
        self._room = min(self._room, rate * BURST_S)

    def charge(self, count: int) -> None:
        """Take bytes at once, on credit."""
        now = self._clock.now()
        self._room = min(self._bytes_per_s * BURST_S, self._room + (now - self._at) * self._bytes_per_s)
        self._at = now
        self._room -= count

    async def take(self, count: int) -> None:
        """Take bytes, and wait until they have been earned. More than a burst at once is allowed, and waited for."""
        self.charge(count)
        owed = -self._room
        while owed > 0:
            rate = self._bytes_per_s
            wait_s = min(owed / rate, LOOK_S)
            await self._clock.sleep(wait_s)
            owed = owed - wait_s * rate if wait_s == LOOK_S else 0.0
