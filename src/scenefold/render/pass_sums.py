"""What one node adds up for one open pass: integers per path, in any order the same bits (specs/08-passes.md, *Sums of a pass on a node*)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.base.limits import BULK_BYTES_MAX, PASS_PATHS_MAX
from scenefold.render.arrays import I32, I64, U16
from scenefold.render.sum_columns import FULL, HIT, PLAIN, SumColumns
from scenefold.render.sums_kernels import add_rows, pack_rows

COUNTERS = 3
_HEAD = struct.Struct(f"<II{COUNTERS}q")


@dataclass(frozen=True, slots=True)
class PassSums:
    """Sums of one pass on one node; `advance` adds to them in place. Columns: sum_columns.py."""

    radiance: I64
    """int64[paths, 3 or 9]"""
    aovs: I32
    """int32[paths, 8 or 13]; written by the node that found the first hit."""
    counters: I64
    """int64[3]: shadow rays cast, contributions that were not finite, contributions clamped."""

    @classmethod
    def zeros(cls, paths: int, columns: SumColumns = PLAIN) -> PassSums:
        """For a pass of this many paths."""
        radiance, aovs = np.zeros((paths, columns.radiance), np.int64), np.zeros((paths, columns.aovs), np.int32)
        return cls(radiance, aovs, np.zeros(COUNTERS, np.int64))

    @property
    def columns(self) -> SumColumns:
        """Which ones there are."""
        return SumColumns(self.radiance.shape[1], self.aovs.shape[1])

    def add(self, other: PassSums) -> None:
        """Add another node's or thread's sums of the same pass."""
        self.radiance[:] += other.radiance
        self.aovs[:] += other.aovs
        self.counters[:] += other.counters

    def to_bytes(self) -> bytes:
        """Only the paths that have something: counts, their numbers, their rows, for radiance and for first hits."""
        lit, radiance = _rows(self.radiance, 0, self.columns.radiance)
        seen, aovs = _rows(self.aovs, HIT, HIT + 1)
        return b"".join(
            (
                _HEAD.pack(len(lit), len(seen), *self.counters.tolist()),
                lit.astype("<u2", copy=False).tobytes(),
                seen.astype("<u2", copy=False).tobytes(),
                radiance.astype("<i8", copy=False).tobytes(),
                np.delete(aovs, HIT, axis=1).astype("<i4", copy=False).tobytes(),
            )
        )

    def add_bytes(self, payload: bytes) -> None:
        """Add what `to_bytes` of another node gave; PeerFault if it does not fit this pass."""
        if len(payload) < _HEAD.size:
            raise PeerFault("sums of a pass are cut off", where=f"{len(payload)} bytes")
        lit_count, seen_count, *counters = _HEAD.unpack_from(payload)
        columns, expected = self.columns, packed_bytes(self.columns, lit_count, seen_count)
        if len(payload) != expected:
            raise PeerFault("sums of a pass have the wrong size", where=f"{len(payload)} bytes instead of {expected}")
        at = _HEAD.size
        lit = np.frombuffer(payload, "<u2", lit_count, at)
        at += 2 * lit_count
        seen = np.frombuffer(payload, "<u2", seen_count, at)
        at += 2 * seen_count
        for numbers in (lit, seen):
            if len(numbers) and (int(numbers[-1]) >= len(self.radiance) or (numbers[1:] <= numbers[:-1]).any()):
                raise PeerFault("sums of a pass name paths that it does not have")
        self.counters[:] += counters
        # Copies, because a payload's numbers may lie at any address.
        radiance = np.frombuffer(payload, "<i8", columns.radiance * lit_count, at).astype(np.int64)
        add_rows(self.radiance, lit.astype(np.uint16), radiance.reshape(-1, columns.radiance))
        at += radiance.nbytes
        aovs = np.frombuffer(payload, "<i4", (columns.aovs - 1) * seen_count, at).astype(np.int32).reshape(-1, columns.aovs - 1)
        add_rows(self.aovs, seen.astype(np.uint16), np.insert(aovs, HIT, 1, axis=1))


def packed_bytes(columns: SumColumns, lit: int, seen: int) -> int:
    """How long the sums of a pass are in which so many paths have radiance, and so many a first hit. HIT, always 1, is left out."""
    return _HEAD.size + lit * (2 + 8 * columns.radiance) + seen * (2 + 4 * (columns.aovs - 1))


assert packed_bytes(FULL, PASS_PATHS_MAX, PASS_PATHS_MAX) <= BULK_BYTES_MAX

_Whole = TypeVar("_Whole", np.int32, np.int64)


def _rows(table: npt.NDArray[_Whole], first: int, last: int) -> tuple[U16, npt.NDArray[_Whole]]:
    """The paths with anything in columns first..last - 1, and their rows."""
    paths, rows = np.empty(len(table), np.uint16), np.empty_like(table)
    count = pack_rows(table, first, last, paths, rows)
    return paths[:count], rows[:count]
