"""What a log sends, each target for itself: who is slow, or gone, holds up nobody else.

A target has a task only as long as there is something for it. Of what it does not take in time only the newest is lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId
from scenefold.consensus import Learn, Message
from scenefold.peer.logs.inbox import bytes_of
from scenefold.peer.logs.ports import Carrier

WAITING_MAX = 512
"""Messages for one target: what is decided comes one by one."""
WAITING_BYTES_MAX = 32 * 1024 * 1024
"""Of the values in them, and in what is being sent."""


class Courier:
    """`lost` is called with whoever cannot be reached."""

    def __init__(self, nursery: trio.Nursery, carrier: Carrier, lost: Callable[[NodeId], None]) -> None:
        self._nursery, self._carrier, self._lost = nursery, carrier, lost
        self._waiting: dict[NodeId, deque[Message]] = {}
        self._bytes: dict[NodeId, int] = {}

    def send(self, target: NodeId, message: Message) -> None:
        """Have it sent, after what was given before. Returns at once."""
        waiting, size = self._waiting.get(target), bytes_of(message)
        if waiting is None:
            self._waiting[target], self._bytes[target] = deque([message]), size
            self._nursery.start_soon(self._carry, target)
        elif len(waiting) < WAITING_MAX and self._bytes[target] + size <= WAITING_BYTES_MAX:
            waiting.append(message)
            self._bytes[target] += size

    async def _carry(self, target: NodeId) -> None:
        waiting = self._waiting[target]
        try:
            while waiting:
                message = waiting.popleft()
                behind = _behind(message, waiting)
                await self._carrier.send(target, message, *behind)
                self._bytes[target] -= sum(map(bytes_of, (message, *behind)))
        except Unreachable:
            self._lost(target)
        finally:
            del self._waiting[target], self._bytes[target]


def _behind(message: Message, waiting: deque[Message]) -> list[Learn]:
    """What is decided behind this one without a gap, and waits for the same target: it is taken out."""
    found: list[Learn] = []
    while isinstance(message, Learn) and waiting:
        following = waiting[0]
        if not isinstance(following, Learn) or following.position != message.position + 1:
            break
        waiting.popleft()
        found.append(following)
        message = following
    return found
