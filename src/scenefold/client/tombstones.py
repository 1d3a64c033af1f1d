"""What a deleted record holds (thesis, NullDataBlob; specs/04-records.md, Deleted records). Pure.

A deletion is a record like any other: it has a version, wins over older ones on every copy, and nodes, which cannot
read it, cannot tell it. It is as long as chance has it, for its length must not tell either.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

MARK = hashlib.sha256(b"scenefold/deleted").digest()[:16]
"""No other payload begins with these bytes."""
PADDING_BYTES_MAX = 2_048
TOMBSTONE_BYTES_MAX = len(MARK) + PADDING_BYTES_MAX


def tombstone(token: Callable[[int], bytes]) -> bytes:
    """The payload of a deletion; `token(count)` gives random bytes."""
    return MARK + token(int.from_bytes(token(2), "big") % PADDING_BYTES_MAX)


def is_tombstone(payload: bytes) -> bool:
    return payload[: len(MARK)] == MARK
