"""Lives that several voters grant: numbered, so that who has missed some need not ask which came first (specs/26-modes.md, Lives, with a
majority). Pure.

A voter keeps of each incarnation the life that it granted last, and takes none below it, nor another one of its number. So of each number one
life is granted by a majority at most, and a copy of a disk that has fallen behind is granted none again.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.peer.cluster_log.lives import NO_LIFE, Lives

NOBODYS = 0
"""The mark that a voter holds where it was told of two lives of one number: it takes neither, and the next."""
FIRST_NUMBER = 0
"""Of the first life that a disk draws; and of all that one voter granted alone, for these had none. So a copy from before a node drew any is
refused where any was granted, in whichever time."""
_LIFE = struct.Struct(">QQ")


class Life(NamedTuple):
    """Lives are drawn one after the other by who holds the one before, so a higher number is a later life; `mark` is random."""

    number: int
    mark: int

    def next(self, mark: int) -> Life:
        """Only once it is known that a majority granted this one."""
        return Life(self.number + 1, mark)

    def pack(self) -> bytes:
        return _LIFE.pack(*self)


def unpack_life(data: bytes) -> Life:
    """DamagedData if this is not what was packed."""
    if len(data) != _LIFE.size:
        raise DamagedData("the life of this node is damaged")
    return Life(*_LIFE.unpack(data))


def of_one_voter(lives: Lives) -> tuple[Life, ...]:
    """What a node asks with that held lives of one voter: that which may have been granted, and if voters know neither it nor a later one, that
    which was, for certain. Nothing if it never asked."""
    return tuple(Life(FIRST_NUMBER, mark) for mark in (lives.now, lives.before) if mark != NO_LIFE)


def takes(held: Life | None, asked: Life) -> bool:
    """Whether a voter that holds this of an incarnation grants a lease under that."""
    return held is None or asked == held or asked.number > held.number


def together(held: Life | None, told: Life) -> Life:
    """What a voter holds that is told what another one held. Of two lives of one number a majority may have granted either, and which is not
    told: neither is taken."""
    if held is None or told.number > held.number:
        return told
    return Life(held.number, NOBODYS) if told.number == held.number and told != held else held


def merged(held: Mapping[bytes, Life], told: Mapping[bytes, Life]) -> dict[bytes, Life]:
    """Likewise of all incarnations."""
    return {**held, **{incarnation: together(held.get(incarnation), life) for incarnation, life in told.items()}}
