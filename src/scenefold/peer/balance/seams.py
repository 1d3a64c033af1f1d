"""What balance, joining and draining ask of the line and of the log; so each can be tested against a small stand-in."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from scenefold.base.location import Arc
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.line.ends import Side
from scenefold.wire import LogEntry, Status

BLOCK_BYTES = 4096


class MovesBounds(Protocol):
    """The line (peer/line)."""

    refuses: str
    """Why no piece is taken; empty: they are."""

    @property
    def arc(self) -> Arc | None: ...
    def busy(self, side: Side, /) -> bool: ...
    def settled(self, arc: Arc, /) -> bool:
        """Whether all of it may move on: nothing came a moment ago, and no giver may still take it back."""
        ...

    def open_handovers(self) -> Sequence[Any]: ...
    async def give(self, side: Side, arc: Arc, /, *, why: str) -> None: ...


class HasRegistry(Protocol):
    """The cluster's log."""

    @property
    def registry(self) -> Registry: ...


class Log(HasRegistry, Protocol):
    """The same, where something is proposed."""

    async def propose(self, entry: LogEntry, request_id: bytes | None = None) -> int: ...


def fill_of(status: Status) -> tuple[int, int]:
    """Bytes used and bytes there are, as a status says."""
    capacity = status.offline_blocks * BLOCK_BYTES
    return capacity * status.offline_fraction >> 32, capacity
