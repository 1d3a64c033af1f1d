"""The logs that this node takes part in, or learns, by genesis: which packet is for which."""

from __future__ import annotations

from collections.abc import Iterator

from scenefold.base.ids import NodeId
from scenefold.consensus import Message
from scenefold.peer.logs.log import Log


class Logs:
    """Used from the Trio thread only."""

    def __init__(self) -> None:
        self._logs: dict[bytes, Log] = {}
        self.packets_sent = 0
        """Of all logs together, to other nodes, since the start."""

    def add(self, log: Log) -> None:
        """From now on packets for it come to it."""
        assert log.genesis not in self._logs, "one task for each log"
        self._logs[log.genesis] = log

    def remove(self, genesis: bytes) -> None:
        del self._logs[genesis]

    def of(self, genesis: bytes) -> Log | None:
        return self._logs.get(genesis)

    def receive(self, sender: NodeId, message: Message) -> bool:
        """A packet of a node; False if this node runs no such log."""
        log = self._logs.get(message.genesis)
        if log is not None:
            log.receive(sender, message)
        return log is not None

    def lost(self, node: NodeId) -> None:
        """A connection to a node is refused, or broken: all logs hear of it."""
        for log in self._logs.values():
            log.lost(node)

    def __iter__(self) -> Iterator[Log]:
        return iter(list(self._logs.values()))
