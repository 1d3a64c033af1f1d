"""What nodes that compare say of versions and sums, as packets have it (specs/03-wire.md, 20-copies.md, Repair). Pure."""

from __future__ import annotations

from scenefold.crypto import RecordHeader
from scenefold.store.versions import RangeSum
from scenefold.wire import RecordVersion

_SUM_BYTES = 32
"""On the wire: as many as a digest has."""

Rank = tuple[int, int, int, int, bytes]
"""Orders the versions of a record: the highest wins."""


def told_version(header: bytes) -> RecordVersion:
    """Which version a record with this header is. IllFormedRecord if it is none."""
    found = RecordHeader.decode(header)
    return RecordVersion(found.epoch, found.seq, found.writer, found.session, found.digest)


def rank_of(version: RecordVersion) -> Rank:
    return version.epoch, version.seq, version.writer, version.session, version.digest


def told_sum(total: RangeSum) -> bytes:
    return total.sum.to_bytes(_SUM_BYTES, "big")
