"""The system's clocks (port `Clock`)."""

from __future__ import annotations

import time

import trio


class RealClock:
    """Monotonic and wall time of this machine."""

    def now(self) -> float:
        return time.monotonic()

    def wall(self) -> float:
        return time.time()

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)
