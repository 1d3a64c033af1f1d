"""What a deleted record holds (thesis, NullDataBlob; specs/04-records.md, Deleted records). Pure.

A deletion is a record like any other: it has a version, wins over older ones on every copy, and nodes, which cannot read it, cannot
tell it. Nor shall its length tell: it is as long as the record that it takes the place of, so that it looks like one that was edited,
or at least as long as others of its space are. Only of large records nothing large is left, for a deletion shall make room.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict, deque
from collections.abc import Callable

from scenefold.base.ids import SpaceId

MARK = hashlib.sha256(b"scenefold/deleted").digest()[:16]
"""No other payload begins with these bytes."""
TOMBSTONE_BYTES_MAX = 3_000
"""With header and signature below the 4 KiB that may be written to a full disk whatever they replace (specs/10-store.md)."""
UNKNOWN_BYTES_MAX = 2_048
"""Of padding where no length of the space is known."""
PLACES_MAX = 4_096
"""Records whose lengths a client remembers, the last that it has read or written."""
SEEN_MAX = 64
"""Lengths of each space that it remembers."""

Token = Callable[[int], bytes]
Key = tuple[SpaceId, bytes] | tuple[SpaceId, bytes, bytes]
"""Space and location, behind which in a node-managed space the record's object id stands, which names it wherever it lies."""


def tombstone(length: int, token: Token) -> bytes:
    """The payload of a deletion of `length` bytes, at least those of the mark; `token(count)` gives random bytes."""
    return MARK + token(length - len(MARK))


def is_tombstone(payload: bytes) -> bool:
    return payload[: len(MARK)] == MARK


class Lengths:
    """How long the payloads are that a client has read or written lately, in one scene."""

    def __init__(self) -> None:
        self._places: OrderedDict[tuple[SpaceId, bytes], int] = OrderedDict()
        self._seen: dict[SpaceId, deque[int]] = {}

    def saw(self, key: Key, payload: bytes) -> None:
        """Deletions count as what they look like."""
        place = key[0], key[-1]
        self._places.pop(place, None)
        if not len(MARK) <= len(payload) <= TOMBSTONE_BYTES_MAX:
            return
        self._places[place] = len(payload)
        if len(self._places) > PLACES_MAX:
            self._places.popitem(last=False)
        # A scene has a few hundred spaces at most.
        self._seen.setdefault(key[0], deque(maxlen=SEEN_MAX)).append(len(payload))

    def of_deletion(self, key: Key, token: Token) -> int:
        """How long a deletion of this record is to be."""
        known = self._places.get((key[0], key[-1]))
        if known is not None:
            return known
        dice = int.from_bytes(token(4), "big")
        seen = self._seen.get(key[0])
        return seen[dice % len(seen)] if seen else len(MARK) + dice % UNKNOWN_BYTES_MAX
