"""Adding closed passes into pixels: whole numbers in two 64-bit limbs, so that any order gives the same bits."""

from __future__ import annotations

import numpy as np
from numba import njit

_SQUARE_UNIT = 65536.0
_SQUARE_MAX = 9.0e18
_RADIANCE_OF_UNIT = 1.0 / 4294967296.0


@njit(error_model="numpy", _nrt=False)
def _add_to_limbs(high, low, pixel, channel, value):  # type: ignore[no-untyped-def]
    """Add a signed 64-bit value to the 128-bit number (high int64, low uint64)."""
    before = low[pixel, channel]
    after = before + np.uint64(value)
    low[pixel, channel] = after
    carry = np.int64(1) if after < before else np.int64(0)
    high[pixel, channel] += carry + (np.int64(-1) if value < 0 else np.int64(0))


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def add_pass(radiance, aovs, first_path, stride, high, low, square_high, square_low, samples, aov_sums):  # type: ignore[no-untyped-def]
    """Add a whole pass, summed per path over all nodes: int64[paths, 3] and int32[paths, 8].

    Squares are taken here, once a path, of its complete radiance. high int64, low uint64, both [pixels, 3], and
    the like for squares; samples int64[pixels]; aov_sums int64[pixels, 8].
    """
    pixels = samples.shape[0]
    for path in range(radiance.shape[0]):
        pixel = (first_path + path) % pixels * stride % pixels
        samples[pixel] += 1
        for channel in range(3):
            value = radiance[path, channel]
            if value != 0:
                _add_to_limbs(high, low, pixel, channel, value)
                real = float(value) * _RADIANCE_OF_UNIT
                square = min(real * real * _SQUARE_UNIT + 0.5, _SQUARE_MAX)
                _add_to_limbs(square_high, square_low, pixel, channel, np.int64(square))
        if aovs[path, 7] != 0:
            for column in range(aovs.shape[1]):
                aov_sums[pixel, column] += aovs[path, column]


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def add_limbs(high, low, other_high, other_low):  # type: ignore[no-untyped-def]
    """Add 128-bit numbers, int64 and uint64 [n, 3], to others in place."""
    for row in range(high.shape[0]):
        for channel in range(high.shape[1]):
            before = low[row, channel]
            after = before + other_low[row, channel]
            low[row, channel] = after
            high[row, channel] += other_high[row, channel] + (np.int64(1) if after < before else np.int64(0))
