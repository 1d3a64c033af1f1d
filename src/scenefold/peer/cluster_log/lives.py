"""Lives: by what the voter tells a node from a restored backup of its disk (specs/15-cluster-log.md, Lives). Pure.

A life is a random number under which a node asks for leases; the voter keeps the last one that it granted. A node draws the
next only when it knows that the last was granted, and writes both down before it asks. So the two on its disk always hold
the one that the voter knows, whatever crashes and whatever answer is lost; and once a later one is granted, a copy of the
disk that does not hold it can never catch up: what it draws is its own, and lives are granted in the order of drawing.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason

LIFE_BYTES = 8
NO_LIFE = 0
_LIVES = struct.Struct(">QQ")
_GRANTED = struct.Struct(">16sQ")


class Lives(NamedTuple):
    """What a node's disk holds. `before`: a life that the voter has granted; `now`: the one that it may have granted since."""

    before: int = NO_LIFE
    now: int = NO_LIFE

    def after(self, drawn: int) -> Lives:
        """The next life. Only once `now` is known to be granted."""
        return Lives(self.now, drawn)

    def pack(self) -> bytes:
        return _LIVES.pack(*self)


def unpack_lives(data: bytes) -> Lives:
    """DamagedData if this is not what was packed."""
    if len(data) != _LIVES.size:
        raise DamagedData("the lives of this node are damaged")
    return Lives(*_LIVES.unpack(data))


def note_of(node: NodeId) -> str:
    """Where the voter keeps what it granted last."""
    return f"cluster-log/life/{node:08x}"


def pack_granted(incarnation: bytes, life: int) -> bytes:
    return _GRANTED.pack(incarnation, life)


def unpack_granted(data: bytes) -> tuple[bytes, int]:
    """DamagedData if this is not what was packed."""
    if len(data) != _GRANTED.size:
        raise DamagedData("the recorded life of a node is damaged")
    incarnation, life = _GRANTED.unpack(data)
    return incarnation, life


def lives_asked_with(values: Sequence[int]) -> Lives:
    """Of a request for a lease. Refused (5) if they are none."""
    if len(values) != 2 or values[1] == NO_LIFE:
        raise Refused(RejectReason.ILL_FORMED, "a lease is asked for under two lives, the second of them not 0")
    return Lives(*values)


def drawn_from(token: bytes) -> int:
    """A life of random bytes; 0 stands for none."""
    return int.from_bytes(token, "big") or 1


def is_restored(granted: int, lives: Lives) -> bool:
    """Whether the asker's disk is an older one than that which was last granted a lease."""
    return granted not in lives
