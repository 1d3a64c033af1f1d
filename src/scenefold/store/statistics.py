"""How much is stored where, kept up to date with every commit instead of being counted."""

from __future__ import annotations

import logging
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from scenefold.base.location import FIRST, LAST
from scenefold.crypto import RecordPlace
from scenefold.store.layout import OBJECTS_END, RECORDS, STATISTICS, SpaceAddress, record_key, space_key, space_of
from scenefold.store.sealing import StoreDamaged
from scenefold.world.ports import DiskSpace, ReadTransaction, WriteTransaction

_COUNTS = struct.Struct(">QQ")

_log = logging.getLogger("scenefold.store")


@dataclass(frozen=True, slots=True)
class Counts:
    """Records and their bytes as stored (header, signature, ciphertext)."""

    records: int = 0
    bytes: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.records + other.records, self.bytes + other.bytes)


@dataclass(frozen=True, slots=True)
class StoreStatistics:
    """A store at one moment. `disk_used_bytes` is what its live data takes, of `disk_total_bytes` that it could take: where
    new records are refused, there is nothing else.
    """

    records: int
    bytes: int
    spaces: Mapping[SpaceAddress, Counts]
    disk_used_bytes: int
    disk_total_bytes: int


def room_beside(space: DiskSpace, reserve_bytes: int) -> int:
    """What new records may take; below zero: so much of the reserve is gone. The rest of the disk is others'."""
    return space.reusable + space.free - reserve_bytes


def capacity_of(statistics: StoreStatistics, share_bytes: int) -> int:
    """What the store may take in all, if it was given a share of the disk (0: all of it). A share is no promise of the disk."""
    return min(share_bytes, statistics.disk_total_bytes) if share_bytes else statistics.disk_total_bytes


def read_counts(transaction: ReadTransaction) -> dict[SpaceAddress, Counts]:
    """All counts, once at the start. What is damaged follows from the records: it is counted, and written at the next change."""
    counts = {}
    for key in transaction.keys(STATISTICS, b"", b"\xff" * 6):
        try:
            value = transaction.get(STATISTICS, key)
        except StoreDamaged as damage:
            _log.error("%s; the records are counted instead", damage.what)
            counts[space_of(key)] = _counted(transaction, space_of(key))
        else:
            assert value is not None
            counts[space_of(key)] = Counts(*_COUNTS.unpack(value))
    return counts


def pack_counts(counts: Counts) -> bytes:
    """A row of the table."""
    return _COUNTS.pack(counts.records, counts.bytes)


def change_counts(transaction: WriteTransaction, space: SpaceAddress, change: Counts) -> Counts:
    """Bring the table up to date; returns the new counts."""
    key = space_key(*space)
    try:
        value = transaction.get(STATISTICS, key)
        counts = change if value is None else Counts(*_COUNTS.unpack(value)) + change
    except StoreDamaged:
        counts = _counted(transaction, space)
    transaction.put(STATISTICS, key, pack_counts(counts))
    return counts


def _counted(transaction: ReadTransaction, space: SpaceAddress) -> Counts:
    """The counts of a space, from its records."""
    first, last = RecordPlace(*space, FIRST), RecordPlace(*space, LAST)
    sizes = [len(value) for _, value in transaction.scan(RECORDS, record_key(first), record_key(last, OBJECTS_END))]
    return Counts(len(sizes), sum(sizes))
