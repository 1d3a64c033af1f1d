"""What the records of an arc add up to, whoever holds them (specs/10-store.md, Digests)."""

from __future__ import annotations

from typing import NamedTuple

from scenefold.crypto import VERSION_BYTES, version_of
from scenefold.store.layout import sound_header

__all__ = ["SUM_BYTES", "SUM_MODULUS", "VERSION_BYTES", "RangeSum", "stored_sum", "sum_of", "version_of"]

SUM_BYTES = 16
SUM_MODULUS = 1 << 8 * SUM_BYTES


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
