"""Worker threads in lanes (port `Workers`).

Each lane has a limiter of its own over Trio's cache of threads: a render that takes every thread of its lane leaves
the store's writer alone. Waiters are tasks of callers that are bounded themselves, so a lane keeps no queue. What a
call costs is on the bill of the request that it serves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

import trio

from scenefold.world.metering import running_bill

T = TypeVar("T")


class RealWorkers:
    """Threads for the lanes given: lane name -> how many calls may run at once."""

    def __init__(self, lanes: Mapping[str, int]) -> None:
        self._lanes = dict(lanes)
        # Limiters belong to one run of Trio, and a world may be made before it starts.
        self._limiters: dict[str, trio.CapacityLimiter] = {}

    def _limiter(self, lane: str) -> trio.CapacityLimiter:
        assert lane in self._lanes, f"no lane is called {lane!r}"
        if lane not in self._limiters:
            self._limiters[lane] = trio.CapacityLimiter(self._lanes[lane])
        return self._limiters[lane]

    async def run(self, lane: str, function: Callable[..., T], *args: object) -> T:
        bill = running_bill()
        if bill is not None:
            return await trio.to_thread.run_sync(bill.in_thread, function, *args, limiter=self._limiter(lane))
        return await trio.to_thread.run_sync(function, *args, limiter=self._limiter(lane))
