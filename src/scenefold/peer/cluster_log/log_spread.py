"""The voter tells everybody what it has committed (packet 6, unasked), as fast as each can take it.

One short task for each node that lacks something, and never two: entries that are committed while a push is under way go
with the next one. So a node that is away holds up nobody else, and a thousand nodes that register at once make a few pushes
to each instead of a thousand. Who misses a push anyway pulls (cluster_log.py).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.peer.peers import Peers
from scenefold.peer.timing import PUSH_PAUSE_EACH_S, PUSH_PAUSE_S, PUSH_S_MAX
from scenefold.wire import RespondSceneLog
from scenefold.world import Clock, Priority

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class LogPusher:
    """`part(have)` makes the packet for a node that has the log up to a position."""

    def __init__(self, clock: Clock, peers: Peers, position: Callable[[], int], part: Callable[[int], RespondSceneLog]) -> None:
        self._clock = clock
        self._peers = peers
        self._position = position
        self._part = part
        self._sent: dict[NodeId, int] = {}
        self._busy: set[NodeId] = set()
        self._nursery: trio.Nursery | None = None

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            task_status.started()
            try:
                await trio.sleep_forever()
            finally:
                # What is decided while the node ends is told by whoever learns of it.
                self._nursery = None

    def note(self, node: NodeId, position: int) -> None:
        """A node has the log up to here, as it says itself."""
        self._sent[node] = max(position, self._sent.get(node, 0))

    def wake(self, nodes: Iterable[NodeId]) -> None:
        """Push to these nodes what they lack."""
        if self._nursery is None:
            return
        for node in nodes:
            if node not in self._busy:
                self._busy.add(node)
                self._nursery.start_soon(self._push, node)

    async def _push(self, node: NodeId) -> None:
        try:
            while self._sent.get(node, 0) < self._position():
                position = self._position()
                try:
                    await self._peers.tell(node, Priority.HIGH, self._part(self._sent.get(node, position - 1)), PUSH_S_MAX)
                except Unreachable as problem:
                    _log.debug("the log is not told to %s: %s", address_of(node), problem)
                    return
                self.note(node, position)
                await self._clock.sleep(max(PUSH_PAUSE_S, PUSH_PAUSE_EACH_S * len(self._sent)))
        finally:
            self._busy.discard(node)
