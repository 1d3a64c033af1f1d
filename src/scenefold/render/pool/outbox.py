"""What waits to be sent to one other node of a job: rays by pass, and small messages.

One task per neighbour sends; while a frame is on its way, rays of the same pass that come after it are
gathered, so that frames grow by themselves when the link is the bottleneck, and leave at once when it is not.
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


class PeerOutbox:
    """Bounded like the job's rays are (`WorkQueue`), and by one small message per pass and kind."""

    def __init__(self) -> None:
        self._rays: dict[int, list[U32]] = {}
        self._messages: deque[Packet] = deque()
        self._filled = trio.Event()
        self.rays_sent = 0
        self.frames_sent = 0

    def put_rays(self, number: int, rays: U32) -> None:
        """Queue rays of a pass."""
        self._rays.setdefault(number, []).append(rays)
        self._filled.set()

    def put_message(self, packet: Packet) -> None:
        """Queue a packet that has no answer."""
        self._messages.append(packet)
        self._filled.set()

    async def run(self, send_rays: Callable[[int, U32], Awaitable[None]], send: Callable[[Packet], Awaitable[None]]) -> None:
        """Send until cancelled; errors of sending end it."""
        while True:
            await self._filled.wait()
            self._filled = trio.Event()
            while self._rays or self._messages:
                while self._messages:
                    await send(self._messages.popleft())
                if self._rays:
                    number = min(self._rays)
                    batches = self._rays.pop(number)
                    rays = batches[0] if len(batches) == 1 else np.concatenate(batches)
                    for first in range(0, len(rays), FRAME_RAYS_MAX):
                        part = rays[first : first + FRAME_RAYS_MAX]
                        await send_rays(number, part)
                        self.rays_sent += len(part)
                        self.frames_sent += 1
