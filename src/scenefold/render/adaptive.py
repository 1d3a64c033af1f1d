"""Adaptive sampling: which pixels go on, decided from whole numbers at fixed counts of samples. Pure.

A level ends when all of its passes have closed, on all nodes, and their films are merged; then every node that looks at the
sums decides the same, since it computes with values that have the same bits everywhere (rounding once, value by value, no sum of
floating-point numbers). What was closed first is no part of it, so a picture depends on its target and not on how it came about.

A pixel goes on if its error, the root of the variance of its mean, is more than `target` times its brightness; dark pixels are taken to be
DARK as bright as the image is in the mean, or they would never end. Its neighbours go on with it: what has happened to one
pixel of an edge, or under a small bright light, will happen to the next one, whose few samples have all missed it yet.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.render.arrays import F64, I64
from scenefold.render.developing import radiance_of, variance_of
from scenefold.render.film import Film
from scenefold.render.sum_columns import RADIANCE_UNIT

FIRST_LEVEL = 16
"""Samples of each pixel before anything is decided: fewer say too little of a pixel's variance."""
DARK = 0.1
Mask = npt.NDArray[np.bool_]


def levels(samples: int) -> tuple[int, ...]:
    """The counts at which is decided who goes on, and the last one, `samples`, at which all end: 16, 32, 64, …"""
    counts = [FIRST_LEVEL]
    while counts[-1] * 2 < samples:
        counts.append(counts[-1] * 2)
    return (*(count for count in counts if count < samples), samples)


def unsettled(film: Film, target: float) -> I64:
    """The pixels that go on after a level, ascending, int64[n]: numbers in the image, row by row from the top left.

    `target`: the relative error that is enough. `film`: the merged one, of all passes of all levels so far.
    """
    assert target > 0.0, "no number of samples is enough for that"
    brightness, error = _squares(film, target)
    noisy = film.in_order(error > brightness)
    return np.flatnonzero(_grown(noisy))


def _squares(film: Film, target: float) -> tuple[F64, F64]:
    """Of each row: the square of the error that is allowed, and of the error that is expected; all three channels together."""
    rows = film.rows
    variance = variance_of(rows)
    mean = radiance_of(rows) / np.maximum(rows.samples, 1)[:, None]
    least = DARK * _mean_light(film)
    light = mean[:, 0] * mean[:, 0] + mean[:, 1] * mean[:, 1] + mean[:, 2] * mean[:, 2]
    return target * target * np.maximum(light, least * least), variance[:, 0] + variance[:, 1] + variance[:, 2]


def _mean_light(film: Film) -> float:
    """Of all pixels and channels, weighed by their samples: one division of whole numbers, in any order the same."""
    rows = film.rows
    low = rows.low.astype(np.uint64)
    upper, lower = int((low >> np.uint64(32)).sum(dtype=np.uint64)), int((low & np.uint64(0xFFFFFFFF)).sum(dtype=np.uint64))
    total = (int(rows.high.sum(dtype=np.int64)) << 64) + (upper << 32) + lower
    samples = int(rows.samples.sum(dtype=np.int64))
    return total / (3 * max(samples, 1)) / RADIANCE_UNIT


def _grown(mask: Mask) -> Mask:
    """With the eight neighbours of each pixel."""
    wide = mask.copy()
    wide[:, 1:] |= mask[:, :-1]
    wide[:, :-1] |= mask[:, 1:]
    tall = wide.copy()
    tall[1:] |= wide[:-1]
    tall[:-1] |= wide[1:]
    return tall
