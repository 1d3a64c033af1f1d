"""The walks of the arithmetic renderer: what a path does at which step, all in whole numbers modulo 2^64, and so the same everywhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.render.arrays import I32, I64, U32
from scenefold.render.rehearsal.lattice import SQUARES
from scenefold.render.sum_columns import CHANNELS, HIT, NORMAL, PLAIN_AOVS

STEPS_MAX = 6
SIDE_RAYS = 4
"""One step of so many makes a side ray."""
U64 = npt.NDArray[np.uint64]
Flags = npt.NDArray[np.bool_]
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_ENDS, _BRANCHES, _SQUARE, _SEAL, _FEATURE, _LIGHT = range(6)
"""What a word of a walk is drawn for."""
_WORDS = 16
"""Of a step; half of them are a side ray's."""
_LIGHT_SHIFT = np.uint64(30)
"""A step adds less than 2^34 units, so that even 2^15 of them are exact as f64, and their sum in any order."""
_FEATURE_SHIFT = np.uint64(40)


def mixed(words: U64) -> U64:
    """The finaliser of splitmix64."""
    words = (words ^ words >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    words = (words ^ words >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return words ^ words >> np.uint64(31)


def keys_of(seed: int, pixels: U64, samples: U64) -> U64:
    """Of the walks of these samples of pixels of the whole image."""
    seeds = mixed(np.full(len(pixels), seed, np.uint64) + _GOLDEN)
    return mixed(mixed(seeds ^ pixels) + samples * _GOLDEN)


def ends_at(keys: U64, steps: U32) -> Flags:
    """Whether a walk ends with this step, one of STEPS_MAX at most."""
    last = _word(keys, np.zeros_like(steps), _ENDS) % np.uint64(STEPS_MAX)
    ends: Flags = steps >= last
    return ends


def has_side_ray(keys: U64, steps: U32) -> Flags:
    """Whether a side ray leaves it there."""
    has: Flags = _word(keys, steps, _BRANCHES) % np.uint64(SIDE_RAYS) == 0
    return has


def squares_of(keys: U64, steps: U32, is_side: Flags) -> I64:
    """Where a walk is at a step, or its side ray ends. More are at the low end: there is work for cells to move after."""
    word = _word(keys, steps, _SQUARE, is_side)
    one, other = word % np.uint64(SQUARES), (word >> np.uint64(32)) % np.uint64(SQUARES)
    squares: I64 = np.minimum(one, other).astype(np.int64)
    return squares


def seals_of(keys: U64, steps: U32, is_side: Flags) -> U64:
    """By which a record is known to be as it was made."""
    return _word(keys, steps, _SEAL, is_side)


def added(keys: U64, steps: U32, is_side: Flags) -> I64:
    """What a walk, or its side ray, adds to its path's sums, i64[n, 3]."""
    return np.stack([_word(keys, steps, _LIGHT + channel, is_side) >> _LIGHT_SHIFT for channel in range(CHANNELS)], axis=1).astype(np.int64)


def features(keys: U64) -> I32:
    """Those of the first hit, i32[n, 8], with HIT 1; only the albedo is something."""
    rows = np.zeros((len(keys), PLAIN_AOVS), np.int32)
    for channel in range(NORMAL):
        rows[:, channel] = _word(keys, np.full(len(keys), channel, np.uint32), _FEATURE) >> _FEATURE_SHIFT
    rows[:, HIT] = 1
    return rows


def _word(keys: U64, steps: U32, what: int, is_side: Flags | None = None) -> U64:
    numbers: U64 = steps.astype(np.uint64) * np.uint64(_WORDS) + np.uint64(what)
    if is_side is not None:
        numbers += is_side.astype(np.uint64) * np.uint64(_WORDS // 2)
    return mixed(keys + numbers * _GOLDEN)


assert _LIGHT + CHANNELS <= _WORDS // 2, "words of a step and of its side ray are apart"
