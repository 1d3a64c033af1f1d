"""The film that an organiser keeps of the passes that are closed, and takes to go on from (specs/08-passes.md, *Kept renders*).

    the film's rows, in their order | from the second level on: a bit for each row, whether it went on to the level of the last pass

Bits as in levels.py. All passes below a number are in it, and no others: so the number says which.
"""

from __future__ import annotations

import numpy as np
import trio

from scenefold.base.errors import PeerFault
from scenefold.render.film import EVERY_ROW, Film, GoesOn
from scenefold.render.film_rows import row_bytes
from scenefold.render.passes import PassPlan
from scenefold.render.sum_columns import SumColumns

STAGE_S = 60.0
"""Between two films that are kept: what an interruption costs at most, beside the time to fetch one."""
FIRST_STAGE_PASSES = 4
"""Of each node, before it is known how fast they are."""
COPIES = 2
"""Of a film at its organiser, beside those of its part: the one that is kept, and that which it makes, or came with the job."""
PIECE_BYTES = 4 * 1024 * 1024


def film_size(plan: PassPlan, columns: SumColumns, pixels: int, passes: int) -> int:
    """The bytes of the film that is kept of so many passes, at least one."""
    return pixels * row_bytes(columns) + (-(-pixels // 8) if plan.level_of(passes - 1) else 0)


def packed_film(film: Film, goes_on: GoesOn) -> bytes:
    """A film, and the rows that went on to the level that it is in."""
    return film.rows.words.tobytes() + np.packbits(goes_on, bitorder="little").tobytes()


def unpack_film(payload: bytes, film: Film) -> GoesOn:
    """Put what `packed_film` made into an empty film; the rows that went on. Its size was looked at before."""
    words = film.rows.words
    words[:] = np.frombuffer(payload, "<u8", words.size).reshape(words.shape)
    bits = np.frombuffer(payload, np.uint8, offset=words.nbytes)
    return np.unpackbits(bits, count=len(words), bitorder="little") if len(bits) else EVERY_ROW


def stage_end(done: int, level_end: int, nodes: int, passes_per_second: float | None, seconds: float = STAGE_S) -> int:
    """Up to which pass the next ones are rendered before the film is kept again; None: nothing was rendered yet."""
    least = nodes * FIRST_STAGE_PASSES
    return min(level_end, done + (least if passes_per_second is None else max(least, int(passes_per_second * seconds))))


def kept_bytes(pixels: int, columns: SumColumns) -> int:
    """What the films take at an organiser that keeps one."""
    return COPIES * pixels * row_bytes(columns)


class ComingFilm:
    """A film that comes in pieces, in order, before a job goes on from it."""

    def __init__(self, size: int) -> None:
        self._size, self._pieces = size, 0
        self._bytes = bytearray()
        self.whole = trio.Event()
        if not size:
            self.whole.set()

    def take(self, index: int, payload: bytes) -> None:
        """The next piece; PeerFault if it is another one, or more than the film."""
        if index != self._pieces or not payload or len(self._bytes) + len(payload) > self._size:
            raise PeerFault("a piece of a kept film does not fit", where=f"piece {index}, {len(payload)} bytes")
        self._bytes += payload
        self._pieces += 1
        if len(self._bytes) == self._size:
            self.whole.set()

    def film(self) -> bytes:
        """All of it; it is let go of."""
        payload = bytes(self._bytes)
        self._bytes.clear()
        return payload
