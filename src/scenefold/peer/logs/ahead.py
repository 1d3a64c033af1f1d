"""What is decided further on than this node is, until it comes to that: values come from several nodes, and overtake one another.

The machine lets such a one go, and asks for what is lacking; which is right, and slow where many come at once.
"""

from __future__ import annotations

from scenefold.consensus import Learn, Received
from scenefold.peer.logs.inbox import size_of

POSITIONS_MAX = 256
BYTES_MAX = 32 * 1024 * 1024


class Ahead:
    """At most one of each position, the newest to come: whether it is true is looked at when its turn comes."""

    def __init__(self) -> None:
        self._kept: dict[int, Received] = {}
        self._bytes = 0

    def keep(self, event: Received, position: int) -> None:
        """Something that is not next. `position`: the newest that is decided here."""
        assert isinstance(event.message, Learn)
        at = event.message.position
        self._drop(at)
        size = size_of(event)
        if position + 1 < at <= position + POSITIONS_MAX and self._bytes + size <= BYTES_MAX:
            self._kept[at] = event
            self._bytes += size

    def take(self, position: int) -> Received | None:
        """What comes next behind this one, if it is here; what lies before that is forgotten."""
        for passed in [at for at in self._kept if at <= position]:
            self._drop(passed)
        return self._drop(position + 1)

    def _drop(self, at: int) -> Received | None:
        event = self._kept.pop(at, None)
        if event is not None:
            self._bytes -= size_of(event)
        return event
