"""Which record it is that lies somewhere, in 32 bytes (specs/10-store.md, Digests).

The digest that a header holds is the ciphertext's, and any writer may sign somebody else's ciphertext again. So two versions
can have it in common, and where one must not be taken for another (what is compared, what is owed) the whole header counts: it
says what the record is, where its home is, which version it is and who wrote it.
"""

from __future__ import annotations

import hashlib
from typing import NamedTuple

from scenefold.store.layout import sound_header

VERSION_BYTES = 32
SUM_BYTES = 16
SUM_MODULUS = 1 << 8 * SUM_BYTES
_DOMAIN = b"scenefold/version"


def version_of(header: bytes) -> bytes:
    """Which version a record with this header is."""
    return hashlib.sha256(_DOMAIN + header).digest()


def sum_of(version: bytes) -> int:
    """What a record of this version adds."""
    return int.from_bytes(version[:SUM_BYTES], "big")


def stored_sum(value: memoryview) -> int | None:
    """What a stored record adds; None if its header has rotted, and nobody knows."""
    header = sound_header(value)
    return None if header is None else sum_of(version_of(header))


class RangeSum(NamedTuple):
    """How many records there are, and the sum of the first 128 bits of their versions, modulo 2^128."""

    records: int = 0
    sum: int = 0

    def and_also(self, records: int, total: int) -> RangeSum:
        return RangeSum(self.records + records, (self.sum + total) % SUM_MODULUS)

    def without(self, other: RangeSum) -> RangeSum:
        return RangeSum(self.records - other.records, (self.sum - other.sum) % SUM_MODULUS)
