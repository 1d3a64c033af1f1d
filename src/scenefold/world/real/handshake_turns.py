"""When the handshakes at a port begin: one after the other, so that what comes in between is handled in between.

A turn is taken when it has come, and not by joining the queue: who is pushed out or gives up leaves it to the next. So the queue
is never longer than those who wait in it.
"""

from __future__ import annotations

import math

import trio


class HandshakeTurns:
    """`gap_s`: from one beginning to the next at least."""

    def __init__(self, gap_s: float) -> None:
        self._gap_s = gap_s
        self._next_at = -math.inf
        self._queue = trio.Lock()

    async def wait(self) -> None:
        """Until it is our turn; they go in the order in which they asked."""
        async with self._queue:
            await trio.sleep_until(max(self._next_at, trio.current_time()))
            self._next_at = trio.current_time() + self._gap_s
