"""Adding closed passes into a film's rows: whole numbers in two limbs, so that any order gives the same bits (film_rows.py).

Carries are added without asking for them: a comparison is 0 or 1, a sign bit spread over a word is 0 or -1.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.sum_columns import ALL_AOVS, HIT, MATERIAL, OBJECT, ONE_PART, POSITION, RADIANCE_UNIT, SQUARE_UNIT

_SQUARE_MAX = 281474976710656.0
"""Of one path, 2^48: that of the brightest contribution. 2^15 of them fit 96 bits; what does not fit is as much as fits."""
_HIGH_MAX = np.int32(0x7FFFFFFF)
_LOW_MAX = np.uint64(0xFFFFFFFFFFFFFFFF)
_LIMB = 18446744073709551616.0
_RADIANCE_OF_UNIT = 1.0 / RADIANCE_UNIT


@njit(error_model="numpy", _nrt=False)
def _add_to_limbs(words, halves, row, word, half, value):  # type: ignore[no-untyped-def]
    """Add a signed 64-bit value to the 96-bit number of a low word and a high half."""
    before = words[row, word]
    after = before + np.uint64(value)
    words[row, word] = after
    halves[row, half] = np.int32(halves[row, half] + np.int64(after < before) + (value >> 63))


@njit(error_model="numpy", _nrt=False)
def _square(value):  # type: ignore[no-untyped-def]
    """Of a path's radiance, in units of 2^-32: its high half, int64, and its low word, uint64."""
    real = float(value) * _RADIANCE_OF_UNIT
    square = min(real * real, _SQUARE_MAX) * SQUARE_UNIT + 0.5
    high = math.floor(square / _LIMB)
    return np.int64(high), np.uint64(square - high * _LIMB)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def add_pass(radiance, aovs, first_path, goes_on, words, halves):  # type: ignore[no-untyped-def]
    """Add a whole pass, summed per path over all nodes: int64[paths, 3 or 9] and int32[paths, 8 or 13].

    Squares are taken here, once a path, of its complete radiance. words uint64[pixels, n], and halves, int32[pixels, 2 n],
    the same memory. Path n of the job belongs to row n mod pixels: consecutive paths to consecutive rows.
    goes_on uint8[pixels], 0 for rows whose paths of the pass are none and were not traced; or uint8[0]: all are.
    """
    pixels = words.shape[0]
    parts, columns = radiance.shape[1], aovs.shape[1]
    full = columns == ALL_AOVS
    features = parts + 3
    half = 2 * (features + HIT + (3 if full else 0))
    count = half + features
    row = first_path % pixels
    sample = first_path // pixels + 1
    chosen = goes_on.shape[0] != 0
    for path in range(radiance.shape[0]):
        traced = not chosen or goes_on[row] != 0
        halves[row, count] += np.int32(traced)
        lit = np.int64(0)
        for column in range(parts if traced else 0):
            lit |= radiance[path, column]
        if lit != 0:
            for channel in range(3):
                value = radiance[path, channel]
                _add_to_limbs(words, halves, row, channel, half + channel, value)
                if parts > ONE_PART:
                    for column in range(channel + 3, parts, 3):
                        more = radiance[path, column]
                        _add_to_limbs(words, halves, row, column, half + column, more)
                        value += more
                high, low = _square(value)
                before = words[row, parts + channel]
                after = before + low
                words[row, parts + channel] = after
                halves[row, half + parts + channel] += np.int32(high + np.int64(after < before))
                if halves[row, half + parts + channel] < 0:
                    words[row, parts + channel], halves[row, half + parts + channel] = _LOW_MAX, _HIGH_MAX
        if traced and aovs[path, HIT] != 0:
            halves[row, count + 1] += aovs[path, HIT]
            for column in range(HIT):
                words[row, features + column] += np.uint64(np.int64(aovs[path, column]))
            if full:
                for column in range(3):
                    words[row, features + HIT + column] += np.uint64(np.int64(aovs[path, POSITION + column]))
                known = halves[row, count + 2]
                if known == 0 or sample < known:
                    halves[row, count + 2] = np.int32(sample)
                    halves[row, count + 3] = aovs[path, OBJECT]
                    halves[row, count + 4] = aovs[path, MATERIAL]
        row += 1
        if row == pixels:
            row = 0
            sample += 1


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def add_rows_of_film(words, halves, other, other_halves, parts, full):  # type: ignore[no-untyped-def]
    """Add rows of another film, of as many pixels and the same columns, to ours; of two first hits the earlier one stays."""
    features = parts + 3
    half = 2 * (features + HIT + (3 if full else 0))
    count = half + features
    for row in range(words.shape[0]):
        for word in range(features):
            before = words[row, word]
            after = before + other[row, word]
            words[row, word] = after
            halves[row, half + word] += np.int32(other_halves[row, half + word] + np.int64(after < before))
            if word >= parts and halves[row, half + word] < 0:
                words[row, word], halves[row, half + word] = _LOW_MAX, _HIGH_MAX
        for word in range(features, half // 2):
            words[row, word] += other[row, word]
        halves[row, count] += other_halves[row, count]
        halves[row, count + 1] += other_halves[row, count + 1]
        if full:
            known, found = halves[row, count + 2], other_halves[row, count + 2]
            if found != 0 and (known == 0 or found < known):
                for at in range(count + 2, count + 5):
                    halves[row, at] = other_halves[row, at]
