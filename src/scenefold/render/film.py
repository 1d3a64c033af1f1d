"""The film: what closed passes add up to, pixel by pixel, in integers (specs/08-passes.md, *The film*).

A film names no order: two films of disjoint passes add up to the same bits, whoever adds them. Its rows stand in the
order of the job's paths, in which a pass is a run of them, and not in that of the image: memory is then read and
written from one end to the other. It travels in parts of whole rows, and becomes an image only at the end (developing.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.render.film_kernels import add_pass, add_rows_of_film
from scenefold.render.film_rows import FilmRows, row_bytes
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.pass_sums import PassSums
from scenefold.render.sum_columns import ALL_AOVS, PLAIN, SumColumns

PART_BYTES = FRAME_BYTES_MAX // 2
U64 = npt.NDArray[np.uint64]
GoesOn = npt.NDArray[np.uint8]
"""Rows, 1 for each whose pixel goes on; empty: all of them do."""
EVERY_ROW: GoesOn = np.zeros(0, np.uint8)
_Scalar = TypeVar("_Scalar", bound=np.generic)


class Film:
    """Sums over a set of passes. Not thread safe."""

    def __init__(self, width: int, height: int, columns: SumColumns = PLAIN) -> None:
        self.width, self.height = width, height
        self.rows = FilmRows.zeros(width * height, columns)
        self._stride = scattering_stride(width * height)

    def add(self, sums: PassSums, first_path: int, stride: int, goes_on: GoesOn = EVERY_ROW) -> None:
        """Add one closed pass, whose `sums` are complete; `stride` of the job's scattered order, which `in_order` undoes.

        `goes_on`: the rows whose paths of the pass were traced, uint8[rows].
        """
        assert stride == self._stride and sums.columns == self.rows.columns, "a pass of another job"
        add_pass(sums.radiance, sums.aovs, np.int64(first_path), goes_on, self.rows.words, self.rows.halves)

    def parts(self) -> Iterator[bytes]:
        """The film as byte strings of at most half a frame, in order."""
        return (self.part(index) for index in range(self.part_count))

    @property
    def part_count(self) -> int:
        """How many parts there are."""
        return -(-len(self.rows.words) // self._part_rows)

    def part(self, index: int, other: Film | None = None) -> bytes:
        """Part `index`, or the sum of this one's and of another's, which both stay as they are."""
        own = self._words_of(index)
        if other is not None:
            own = own.copy()
            self._add_rows(own, other._words_of(index))
        return own.tobytes()

    def merge_part(self, index: int, payload: bytes) -> None:
        """Add part `index` of another film of the same job; PeerFault if it does not fit."""
        own = self._words_of(index)
        if len(own) == 0 or len(payload) != own.nbytes:
            raise PeerFault("a film part has the wrong size", where=f"part {index} of {self.part_count}, {len(payload)} bytes")
        # A copy, because a payload's numbers may lie at any address.
        self._add_rows(own, np.frombuffer(payload, "<u8").astype(np.uint64).reshape(own.shape))

    def merge(self, other: Film) -> None:
        """Add another film of the same job."""
        self._add_rows(self.rows.words, other.rows.words)

    def add_rows(self, first: int, words: U64) -> None:
        """Add rows of another film of the same job, which are ours from row `first` on."""
        own = self.rows.words[first : first + len(words)]
        assert own.shape == words.shape, "rows of another film"
        self._add_rows(own, words)

    def _words_of(self, index: int) -> U64:
        first = index * self._part_rows if 0 <= index < self.part_count else len(self.rows.words)
        return self.rows.words[first : first + self._part_rows]

    def _add_rows(self, own: U64, other: U64) -> None:
        columns = self.rows.columns
        full = np.int64(columns.aovs == ALL_AOVS)
        add_rows_of_film(own, own.view(np.int32), other, other.view(np.int32), np.int64(columns.radiance), full)

    def pixels_of_rows(self, first: int, last: int) -> npt.NDArray[np.int64]:
        """Where in the image these rows' pixels are: left to right, top row first."""
        return np.arange(first, last) * self._stride % (self.width * self.height)

    def in_order(self, values: npt.NDArray[_Scalar]) -> npt.NDArray[_Scalar]:
        """What stands in the order of the rows, in that of the image: [rows, ...] to [H, W, ...], top row first."""
        image = np.empty_like(values)
        image[self.pixels_of_rows(0, len(values))] = values
        return image.reshape(self.height, self.width, *values.shape[1:])

    def in_rows(self, image: npt.NDArray[_Scalar]) -> npt.NDArray[_Scalar]:
        """What stands in the order of the image, [H, W, ...], in that of the rows, [rows, ...]."""
        pixels = self.width * self.height
        return image.reshape(pixels, *image.shape[2:])[self.pixels_of_rows(0, pixels)]

    @property
    def _part_rows(self) -> int:
        return PART_BYTES // row_bytes(self.rows.columns)
