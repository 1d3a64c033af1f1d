"""What one node adds up for one open pass: integers per path, in any order the same bits (rendering.md, Passes)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.render.arrays import I32, I64, U16
from scenefold.render.sums_kernels import add_rows, pack_rows

AOV_COLUMNS = 8
COUNTERS = 3


@dataclass(frozen=True, slots=True)
class PassSums:
    """Sums of one pass on one node; `advance` adds to them in place."""

    radiance: I64
    """int64[paths, 3], units of 2^-32."""
    aovs: I32
    """int32[paths, 8]: albedo, normal, depth, hit; written by the node that found the first hit."""
    counters: I64
    """int64[3]: shadow rays cast, contributions that were not finite, contributions clamped."""

    @classmethod
    def zeros(cls, paths: int) -> PassSums:
        """For a pass of this many paths."""
        return cls(np.zeros((paths, 3), np.int64), np.zeros((paths, AOV_COLUMNS), np.int32), np.zeros(COUNTERS, np.int64))

    def add(self, other: PassSums) -> None:
        """Add another node's or thread's sums of the same pass."""
        self.radiance[:] += other.radiance
        self.aovs[:] += other.aovs
        self.counters[:] += other.counters

    def to_bytes(self) -> bytes:
        """Only the paths that have something: counts, their numbers, their rows, for radiance and for AOVs."""
        lit, radiance = _rows(self.radiance, 0, 3)
        seen, aovs = _rows(self.aovs, AOV_COLUMNS - 1, AOV_COLUMNS)
        return b"".join(
            (
                struct.pack("<II", len(lit), len(seen)),
                self.counters.astype("<i8").tobytes(),
                lit.astype("<u2", copy=False).tobytes(),
                seen.astype("<u2", copy=False).tobytes(),
                radiance.astype("<i8", copy=False).tobytes(),
                aovs.astype("<i4", copy=False).tobytes(),
            )
        )

    def add_bytes(self, payload: bytes) -> None:
        """Add what `to_bytes` of another node gave; PeerFault if it does not fit this pass."""
        head = struct.calcsize("<II") + 8 * COUNTERS
        if len(payload) < head:
            raise PeerFault("sums of a pass are cut off", where=f"{len(payload)} bytes")
        lit_count, seen_count = struct.unpack_from("<II", payload)
        expected = head + lit_count * (2 + 24) + seen_count * (2 + 4 * AOV_COLUMNS)
        if len(payload) != expected:
            raise PeerFault("sums of a pass have the wrong size", where=f"{len(payload)} bytes instead of {expected}")
        at = head
        lit = np.frombuffer(payload, "<u2", lit_count, at)
        at += 2 * lit_count
        seen = np.frombuffer(payload, "<u2", seen_count, at)
        at += 2 * seen_count
        for numbers in (lit, seen):
            if len(numbers) and (int(numbers[-1]) >= len(self.radiance) or (numbers[1:] <= numbers[:-1]).any()):
                raise PeerFault("sums of a pass name paths that it does not have")
        self.counters[:] += np.frombuffer(payload, "<i8", COUNTERS, 8)
        # Copies, because a payload's numbers may lie at any address.
        add_rows(self.radiance, lit.astype(np.uint16), np.frombuffer(payload, "<i8", 3 * lit_count, at).astype(np.int64).reshape(-1, 3))
        at += 24 * lit_count
        aovs = np.frombuffer(payload, "<i4", AOV_COLUMNS * seen_count, at).astype(np.int32).reshape(-1, AOV_COLUMNS)
        add_rows(self.aovs, seen.astype(np.uint16), aovs)


_Whole = TypeVar("_Whole", np.int32, np.int64)


def _rows(table: npt.NDArray[_Whole], first: int, last: int) -> tuple[U16, npt.NDArray[_Whole]]:
    """The paths with anything in columns first..last - 1, and their rows."""
    paths, rows = np.empty(len(table), np.uint16), np.empty_like(table)
    count = pack_rows(table, first, last, paths, rows)
    return paths[:count], rows[:count]
