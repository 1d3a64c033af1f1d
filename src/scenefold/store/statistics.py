"""How much is stored where, kept up to date with every commit instead of being counted."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from scenefold.base.ids import SceneId, SpaceId
from scenefold.store.layout import STATISTICS, space_key, space_of
from scenefold.world.ports import ReadTransaction, WriteTransaction

_COUNTS = struct.Struct(">QQ")

SpaceAddress = tuple[SceneId, SpaceId]


@dataclass(frozen=True, slots=True)
class Counts:
    """Records and their bytes as stored (header, signature, ciphertext)."""

    records: int = 0
    bytes: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.records + other.records, self.bytes + other.bytes)


@dataclass(frozen=True, slots=True)
class StoreStatistics:
    """A store at one moment. `disk_used_bytes` is what its live data takes, of `disk_total_bytes` it could take."""

    records: int
    bytes: int
    spaces: Mapping[SpaceAddress, Counts]
    disk_used_bytes: int
    disk_total_bytes: int


@dataclass(slots=True)
class Tally:
    """Differences that one transaction makes, written once at its end."""

    changes: defaultdict[SpaceAddress, list[int]] = field(default_factory=lambda: defaultdict(lambda: [0, 0]))

    def add(self, space: SpaceAddress, records: int, stored_bytes: int) -> None:
        change = self.changes[space]
        change[0] += records
        change[1] += stored_bytes

    def write(self, transaction: WriteTransaction) -> dict[SpaceAddress, Counts]:
        """Bring the table up to date; returns the new counts of the spaces that changed."""
        changed = {}
        for space, (records, stored_bytes) in self.changes.items():
            key = space_key(*space)
            value = transaction.get(STATISTICS, key)
            before = Counts(*_COUNTS.unpack(value)) if value is not None else Counts()
            changed[space] = before + Counts(records, stored_bytes)
            transaction.put(STATISTICS, key, _COUNTS.pack(changed[space].records, changed[space].bytes))
        return changed


def read_counts(transaction: ReadTransaction) -> dict[SpaceAddress, Counts]:
    """All counts, once at the start."""
    rows = transaction.scan(STATISTICS, b"", b"\xff" * 6)
    return {space_of(key): Counts(*_COUNTS.unpack(value)) for key, value in rows}
