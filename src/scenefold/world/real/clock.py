"""The system's clocks (port `Clock`)."""

from __future__ import annotations

import time
from collections.abc import Callable

import trio

# Linux stops its plain monotonic clock while the machine sleeps. Elsewhere the best that there is must do.
_EVER_RUNNING = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", None))


class RealClock:
    """Monotonic and wall time of this machine."""

    def now(self) -> float:
        return time.monotonic() if _EVER_RUNNING is None else time.clock_gettime(_EVER_RUNNING)

    def wall(self) -> float:
        return time.time()

    @property
    def stopwatch(self) -> Callable[[], float]:
        return time.monotonic

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)
