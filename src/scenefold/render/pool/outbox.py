"""What waits to be sent to one other node of a job: rays by pass, and small messages.

One task per neighbour sends. Rays linger for a moment, or until there are enough for a large frame, or until
their node has nothing else to do (`hurry`): a frame costs what a thousand rays cost to trace, however small it is.
While a frame is on its way, rays that come after it are gathered too.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable

import numpy as np
import trio

from scenefold.render.arrays import U32
from scenefold.wire import Packet

FRAME_RAYS_MAX = 16_384
"""576 KiB of rays in a frame."""
FRAME_RAYS_ENOUGH = 4_096
"""So many waiting rays leave at once."""
LINGER_S = 0.02


class PeerOutbox:
    """Bounded like the job's rays are (`WorkQueue`), and by one small message per pass and kind."""

    def __init__(self) -> None:
        self._rays: dict[tuple[int, int], list[U32]] = {}
        """By the epoch by which they are addressed, and pass."""
        self._messages: deque[Packet] = deque()
        self._waiting = 0
        self._filled = trio.Event()
        self._enough = trio.Event()
        self.rays_sent = 0
        self.frames_sent = 0

    def put_rays(self, epoch: int, number: int, rays: U32) -> None:
        """Queue rays of a pass that are addressed by the partition of this epoch."""
        self._rays.setdefault((epoch, number), []).append(rays)
        self._waiting += len(rays)
        self._filled.set()
        if self._waiting >= FRAME_RAYS_ENOUGH:
            self._enough.set()

    def put_message(self, packet: Packet) -> None:
        """Queue a packet that has no answer."""
        self._messages.append(packet)
        self._filled.set()

    def hurry(self) -> None:
        """Whoever fills this box has nothing else to do: send what there is."""
        self._enough.set()

    async def run(self, send_rays: Callable[[int, int, U32], Awaitable[None]], send: Callable[[Packet], Awaitable[None]]) -> None:
        """Send until cancelled; errors of sending end it."""
        while True:
            await self._filled.wait()
            with trio.move_on_after(LINGER_S):
                await self._enough.wait()
            self._filled, self._enough = trio.Event(), trio.Event()
            while self._rays or self._messages:
                while self._messages:
                    await send(self._messages.popleft())
                if self._rays:
                    epoch, number = first_due = min(self._rays)
                    batches = self._rays.pop(first_due)
                    self._waiting -= sum(len(batch) for batch in batches)
                    rays = batches[0] if len(batches) == 1 else np.concatenate(batches)
                    for first in range(0, len(rays), FRAME_RAYS_MAX):
                        part = rays[first : first + FRAME_RAYS_MAX]
                        await send_rays(epoch, number, part)
                        self.rays_sent += len(part)
                        self.frames_sent += 1
