"""Random numbers of a path: a function of (seed, frame, pixel, sample, bounce, dimension) and nothing else (specs/07-rays.md).

Two samplers. `independent` hashes all of it. `sobol` takes the sample's number as the index into Sobol's first two
dimensions, shuffled and scrambled anew for every pixel, bounce and pair of dimensions: so the samples of a pixel are
spread evenly over each pair, and still every one of them is uniform (Burley, Practical Hash-based Owen Scrambling,
JCGT 2020; the hash is Laine's and Karras's). What is drawn belongs in pairs accordingly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.render.lane_values_kernels import real_of_whole, reversed_bits

PAIRS_PER_BOUNCE = 8
PAIR_SCATTER = 0
"""Which way the surface scatters."""
PAIR_LOBE_ROULETTE = 1
PAIR_LIGHT = 2
"""Which kind of light, which emitter."""
PAIR_LIGHT_POINT = 3
PAIR_PIXEL = 4
"""Place in the pixel; camera rays only."""
PAIR_LENS = 5
NOISE_THROUGHPUT = 6
NOISE_CONTRIBUTION = 7

SAMPLER_SOBOL = 0
SAMPLER_INDEPENDENT = 1

_GOLDEN = np.uint32(0x9E3779B9)
_SECOND = np.uint32(0x85EBCA6B)
_TO_UNIT = 1.0 / 16777216.0


class Dice(NamedTuple):
    """What random numbers of a path's bounce follow from: words."""

    seed: Any
    """Of the pixel, for this job and frame."""
    sample: Any
    bounce: Any


@njit(error_model="numpy", _nrt=False, forceinline=True)
def hash32(x):  # type: ignore[no-untyped-def]
    """A bijection of 32 bits that avalanches well (Wellons's lowbias32); lanes."""
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def dice_of(job, pixel, sample, bounce):  # type: ignore[no-untyped-def]
    """The dice of a bounce of paths: words."""
    return Dice(hash32(hash32(pixel + np.uint32(job.dice_low)) ^ np.uint32(job.dice_high)), sample, bounce)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _seed_of(dice, number):  # type: ignore[no-untyped-def]
    return hash32(dice.seed ^ ((dice.bounce * np.uint32(PAIRS_PER_BOUNCE) + np.uint32(number + 1)) * _GOLDEN))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _scrambled(x, seed):  # type: ignore[no-untyped-def]
    """Every bit is flipped, or not, by a hash of the ones below it: Owen's scrambling of the word with its bits reversed."""
    x = x ^ (x * np.uint32(0x3D20ADEA))
    x = (x + seed) * ((seed >> np.uint32(16)) | np.uint32(1))
    x = x ^ (x * np.uint32(0x05526C56))
    return x ^ (x * np.uint32(0x53A22864))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _pascal(x):  # type: ignore[no-untyped-def]
    """Sobol's second dimension, bits reversed: Pascal's triangle modulo 2, which is five steps of a sum over supersets."""
    x = x ^ ((x >> np.uint32(1)) & np.uint32(0x55555555))
    x = x ^ ((x >> np.uint32(2)) & np.uint32(0x33333333))
    x = x ^ ((x >> np.uint32(4)) & np.uint32(0x0F0F0F0F))
    x = x ^ ((x >> np.uint32(8)) & np.uint32(0x00FF00FF))
    return x ^ ((x >> np.uint32(16)) & np.uint32(0x0000FFFF))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def unit_of(word):  # type: ignore[no-untyped-def]
    """[0, 1) of the 24 upper bits."""
    return real_of_whole(word >> np.uint32(8)) * _TO_UNIT


@njit(error_model="numpy", _nrt=False, forceinline=True)
def pair_of_words(job, dice, number):  # type: ignore[no-untyped-def]
    """Two numbers of 32 bits for one of the PAIR_ dimensions."""
    seed = _seed_of(dice, number)
    if job.sampler == SAMPLER_INDEPENDENT:
        first = hash32(seed ^ (dice.sample * _GOLDEN + _SECOND))
        return first, hash32(first ^ _SECOND)
    index = reversed_bits(_scrambled(reversed_bits(dice.sample), seed))
    first, second = hash32(seed ^ _GOLDEN), hash32(seed ^ _SECOND)
    return reversed_bits(_scrambled(index, first)), reversed_bits(_scrambled(_pascal(index), second))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def pair(job, dice, number):  # type: ignore[no-untyped-def]
    """The same as numbers in [0, 1), multiples of 2^-24."""
    first, second = pair_of_words(job, dice, number)
    return unit_of(first), unit_of(second)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def column_of(word, count):  # type: ignore[no-untyped-def]
    """One of `count` columns by a word, floor(word * count / 2^32), and how far into it, in [0, 1).

    In whole numbers: of a million columns a number of 24 bits would leave out some, and hit others a third too often.
    """
    few = np.uint32(0xFFFF)
    all_of = np.uint32(count)
    low, high, count_low, count_high = word & few, word >> np.uint32(16), all_of & few, all_of >> np.uint32(16)
    across, back = high * count_low, low * count_high
    carried = ((low * count_low) >> np.uint32(16)) + (across & few) + (back & few)
    column = high * count_high + (across >> np.uint32(16)) + (back >> np.uint32(16)) + (carried >> np.uint32(16))
    return column, unit_of(word * all_of)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def noise(dice, number):  # type: ignore[no-untyped-def]
    """Three independent numbers in (0, 1), of 10 bits each, to round a colour by: for one of the NOISE_ dimensions."""
    word = hash32(_seed_of(dice, number) ^ (dice.sample * _GOLDEN + _SECOND))
    mask = np.uint32(0x3FF)
    return (
        (real_of_whole(word & mask) + 0.5) * (1.0 / 1024.0),
        (real_of_whole((word >> np.uint32(10)) & mask) + 0.5) * (1.0 / 1024.0),
        (real_of_whole((word >> np.uint32(20)) & mask) + 0.5) * (1.0 / 1024.0),
    )
