"""The film: what closed passes add up to, pixel by pixel, in integers (specs/08-passes.md).

Radiance in units of 2^-32 and its square in units of 2^-16, both in two 64-bit limbs; features of first hits in
units of 2^-24. A film names no order: two films of disjoint passes add up to the same bits, whoever
adds them. It travels in parts of whole rows, and becomes an image only at the end, by one division a value.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.render.arrays import F32, F64, I64
from scenefold.render.film_kernels import add_limbs, add_pass
from scenefold.render.pass_sums import AOV_COLUMNS, PassSums

_ROW = np.dtype(
    [
        ("high", "<i8", 3),
        ("low", "<u8", 3),
        ("square_high", "<i8", 3),
        ("square_low", "<u8", 3),
        ("samples", "<i8"),
        ("aovs", "<i8", AOV_COLUMNS),
    ]
)
_AOV_UNIT = 16777216.0
PART_PIXELS = FRAME_BYTES_MAX // 2 // _ROW.itemsize
BYTES_PER_PIXEL = _ROW.itemsize
"""Memory that a film takes."""


class Film:
    """Sums over a set of passes. Not thread safe."""

    def __init__(self, width: int, height: int) -> None:
        pixels = width * height
        self.width, self.height = width, height
        self._high = np.zeros((pixels, 3), np.int64)
        self._low = np.zeros((pixels, 3), np.uint64)
        self._square_high = np.zeros((pixels, 3), np.int64)
        self._square_low = np.zeros((pixels, 3), np.uint64)
        self._samples = np.zeros(pixels, np.int64)
        self._aovs = np.zeros((pixels, AOV_COLUMNS), np.int64)

    def add(self, sums: PassSums, first_path: int, stride: int) -> None:
        """Add one closed pass, whose `sums` are complete."""
        add_pass(
            sums.radiance,
            sums.aovs,
            np.int64(first_path),
            np.int64(stride),
            self._high,
            self._low,
            self._square_high,
            self._square_low,
            self._samples,
            self._aovs,
        )

    def parts(self) -> Iterator[bytes]:
        """The film as byte strings of at most half a frame, in order."""
        for first in range(0, len(self._samples), PART_PIXELS):
            yield self._rows(slice(first, first + PART_PIXELS)).tobytes()

    @property
    def part_count(self) -> int:
        """How many parts there are."""
        return -(-len(self._samples) // PART_PIXELS)

    def merge_part(self, index: int, payload: bytes) -> None:
        """Add part `index` of another film of the same size; PeerFault if it does not fit."""
        first = index * PART_PIXELS
        rows = slice(first, min(first + PART_PIXELS, len(self._samples)))
        if not 0 <= index < self.part_count or len(payload) != (rows.stop - first) * _ROW.itemsize:
            raise PeerFault("a film part has the wrong size", where=f"part {index} of {self.part_count}, {len(payload)} bytes")
        other = np.frombuffer(payload, _ROW)
        add_limbs(self._high[rows], self._low[rows], _own(other["high"]), _own(other["low"]))
        add_limbs(self._square_high[rows], self._square_low[rows], _own(other["square_high"]), _own(other["square_low"]))
        self._samples[rows] += other["samples"]
        self._aovs[rows] += other["aovs"]

    def layers(self, diagonal: float) -> dict[str, F32]:
        """The image, top row first: beauty, albedo, normal [H, W, 3] and depth [H, W], all float32.

        `diagonal` is the job's box's, in whose shares depth was counted. Depth is infinite where no path hit.
        """
        shape = (self.height, self.width)
        counts: F64 = np.maximum(self._samples, 1).astype(np.float64)
        hits: F64 = np.maximum(self._aovs[:, 7], 1).astype(np.float64)
        beauty = _as_reals(self._high, self._low) / 4294967296.0 / counts[:, None]
        albedo = self._aovs[:, 0:3] / _AOV_UNIT / counts[:, None]
        normal = self._aovs[:, 3:6] / _AOV_UNIT / counts[:, None]
        depth = self._aovs[:, 6] / _AOV_UNIT / hits * diagonal
        depth[self._aovs[:, 7] == 0] = np.inf
        return {
            "beauty": beauty.astype(np.float32).reshape(*shape, 3),
            "albedo": albedo.astype(np.float32).reshape(*shape, 3),
            "normal": normal.astype(np.float32).reshape(*shape, 3),
            "depth": depth.astype(np.float32).reshape(shape),
        }

    def variance(self) -> F64:
        """The variance of each pixel's mean, [H, W, 3], from the sums of squares."""
        counts: F64 = np.maximum(self._samples, 1).astype(np.float64)[:, None]
        mean = _as_reals(self._high, self._low) / 4294967296.0 / counts
        mean_square = _as_reals(self._square_high, self._square_low) / 65536.0 / counts
        spread: F64 = np.maximum(mean_square - mean * mean, 0.0) / np.maximum(counts - 1.0, 1.0)
        return spread.reshape(self.height, self.width, 3)

    @property
    def samples(self) -> I64:
        """Paths per pixel, [H, W]."""
        return self._samples.reshape(self.height, self.width)

    def _rows(self, rows: slice) -> npt.NDArray[np.void]:
        packed = np.zeros(len(self._samples[rows]), _ROW)
        packed["high"], packed["low"] = self._high[rows], self._low[rows]
        packed["square_high"], packed["square_low"] = self._square_high[rows], self._square_low[rows]
        packed["samples"], packed["aovs"] = self._samples[rows], self._aovs[rows]
        return packed


def _own(column: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    return np.ascontiguousarray(column)


def _as_reals(high: I64, low: npt.NDArray[np.uint64]) -> F64:
    """128-bit numbers as f64: the same rounding everywhere, whole numbers being converted one limb at a time."""
    reals: F64 = high.astype(np.float64) * 18446744073709551616.0 + low.astype(np.float64)
    return reals
