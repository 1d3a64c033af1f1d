"""How it is told which pixels go on to a level: a bit each, in pieces that fit a job's event (specs/08-passes.md, *Adaptive sampling*).

    {"level": its number, from 1 on, "at": bytes that came before, "goes_on": bytes, "last": whether no more will come}

Bit r mod 8 of byte r div 8, counted from the least, is that of row r.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.base.plain_values import whole
from scenefold.render.film import GoesOn
from scenefold.wire import Value

PIECE_BYTES = 128 * 1024


def pieces(level: int, goes_on: GoesOn) -> Iterator[dict[str, Value]]:
    """The documents that tell it, in order."""
    bits = np.packbits(goes_on, bitorder="little").tobytes()
    for at in range(0, len(bits), PIECE_BYTES):
        yield {"level": level, "at": at, "goes_on": bits[at : at + PIECE_BYTES], "last": at + PIECE_BYTES >= len(bits)}


class Gathered:
    """What a node was told of the next level so far."""

    def __init__(self, rows: int, levels: int) -> None:
        self._rows, self._levels = rows, levels
        self._level = self._coming = 0
        self._bits = bytearray()

    def take(self, document: dict[str, Any]) -> GoesOn | None:
        """The rows once all is there. PeerFault for what is not the next piece of a level, or the first one of a later level."""
        try:
            level, at, bits = whole(document["level"], 1, self._levels - 1), whole(document["at"], 0, self._rows), document["goes_on"]
            if not isinstance(bits, bytes) or not isinstance(document["last"], bool):
                raise TypeError("bits are expected")
            follows = level == self._coming if at else level > self._level and not self._bits
            if not follows or at != len(self._bits) or (at + len(bits) == -(-self._rows // 8)) != document["last"]:
                raise ValueError(f"level {level} at {at} does not follow on level {self._level} and {len(self._bits)} bytes")
        except (KeyError, TypeError, ValueError) as error:
            raise PeerFault("which pixels go on is ill-formed", where=f"{type(error).__name__}: {error}") from error
        self._bits += bits
        self._coming = level
        if not document["last"]:
            return None
        goes_on = np.unpackbits(np.frombuffer(self._bits, np.uint8), count=self._rows, bitorder="little")
        self._level, self._bits = level, bytearray()
        return goes_on
