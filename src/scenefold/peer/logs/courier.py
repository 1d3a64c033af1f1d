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
from scenefold.peer.logs.ports import Carrier

WAITING_MAX = 512
"""Messages for one target: what is decided comes one by one."""


class Courier:
    """`lost` is called with whoever cannot be reached."""

    def __init__(self, nursery: trio.Nursery, carrier: Carrier, lost: Callable[[NodeId], None]) -> None:
        self._nursery, self._carrier, self._lost = nursery, carrier, lost
        self._waiting: dict[NodeId, deque[Message]] = {}

    def send(self, target: NodeId, message: Message) -> None:
        """Have it sent, after what was given before. Returns at once."""
        waiting = self._waiting.get(target)
        if waiting is None:
            self._waiting[target] = deque([message])
            self._nursery.start_soon(self._carry, target)
        elif len(waiting) < WAITING_MAX:
            waiting.append(message)

    async def _carry(self, target: NodeId) -> None:
        waiting = self._waiting[target]
        try:
            while waiting:
                message = waiting.popleft()
                await self._carrier.send(target, message, *_behind(message, waiting))
        except Unreachable:
            self._lost(target)
        finally:
            del self._waiting[target]


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
