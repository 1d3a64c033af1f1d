"""A film's row: what is known of one pixel, in one piece of memory (specs/08-passes.md, *The film*).

    u64  radiance, low limbs          3 or 9, as the columns of a pass
    u64  squares, low limbs           3
    i64  features of first hits       7, or 10 with the position
    i32  radiance, high limbs         3 or 9
    i32  squares, high limbs          3
    u32  samples | u32 hits
    u32  sample of the first hit + 1, or 0 | i32 its object | i32 its material     with the position only
    u32  0, where rows would not end on eight bytes else

One row instead of a table for each kind: a path touches two or three cache lines, one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.render.sum_columns import ALL_AOVS, CHANNELS, SumColumns

I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U64 = npt.NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class FilmRows:
    """The rows of a film, uint64[pixels, words], and views of their parts."""

    columns: SumColumns
    words: U64

    @classmethod
    def zeros(cls, pixels: int, columns: SumColumns) -> FilmRows:
        """Rows of pixels that nothing is known of."""
        return cls(columns, np.zeros((pixels, row_bytes(columns) // 8), np.uint64))

    def part(self, first: int, last: int) -> FilmRows:
        """Rows first .. last - 1, in the same memory."""
        return FilmRows(self.columns, self.words[first:last])

    @property
    def halves(self) -> I32:
        """The same memory, int32[pixels, 2 x words]."""
        return self.words.view(np.int32)

    @property
    def low(self) -> U64:
        """uint64[pixels, 3 or 9]"""
        return self.words[:, : self.columns.radiance]

    @property
    def square_low(self) -> U64:
        """uint64[pixels, 3]"""
        return self.words[:, self.columns.radiance : self.columns.radiance + CHANNELS]

    @property
    def features(self) -> I64:
        """int64[pixels, 7 or 10]: albedo, normal, depth, position."""
        first = self.columns.radiance + CHANNELS
        return self.words[:, first : first + self.columns.feature_sums].view(np.int64)

    @property
    def high(self) -> I32:
        """int32[pixels, 3 or 9]"""
        return self.halves[:, self._half : self._half + self.columns.radiance]

    @property
    def square_high(self) -> I32:
        """int32[pixels, 3]"""
        first = self._half + self.columns.radiance
        return self.halves[:, first : first + CHANNELS]

    @property
    def samples(self) -> I32:
        """int32[pixels]: paths."""
        return self.halves[:, self._counts]

    @property
    def hits(self) -> I32:
        """int32[pixels]: paths that hit something."""
        return self.halves[:, self._counts + 1]

    @property
    def first_hits(self) -> I32:
        """int32[pixels, 3]: sample of the first hit + 1, or 0; its object; its material."""
        assert self.columns.aovs == ALL_AOVS, "numbers of objects and materials were not written"
        return self.halves[:, self._counts + 2 : self._counts + 5]

    @property
    def _half(self) -> int:
        return 2 * (self.columns.radiance + CHANNELS + self.columns.feature_sums)

    @property
    def _counts(self) -> int:
        return self._half + self.columns.radiance + CHANNELS


def row_bytes(columns: SumColumns) -> int:
    """Of one pixel."""
    words = columns.radiance + CHANNELS + columns.feature_sums
    halves = columns.radiance + CHANNELS + 2 + (3 if columns.aovs == ALL_AOVS else 0)
    return 8 * (words + (halves + 1) // 2)
