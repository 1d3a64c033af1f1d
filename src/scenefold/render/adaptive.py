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

from scenefold.render.arrays import F64
from scenefold.render.developing import radiance_of, variance_of
from scenefold.render.film import EVERY_ROW, Film, GoesOn
from scenefold.render.film_rows import FilmRows
from scenefold.render.sum_columns import RADIANCE_UNIT

DARK = 0.1
_ROWS_AT_A_TIME = 65_536
"""So that what is computed on the way takes little memory beside the film."""
Mask = npt.NDArray[np.bool_]


def going_on(film: Film, target: float, before: GoesOn = EVERY_ROW) -> GoesOn:
    """The rows whose pixels go on after a level, uint8[rows]. A pixel that ended stays ended, so its samples are always its first ones.

    `target`: the relative error that is enough. `film`: the merged one, of all passes of all levels so far.
    `before`: those that went on to the level that ends.
    """
    assert target > 0.0, "no number of samples is enough for that"
    least = DARK * _mean_light(film)
    noisy = np.empty(len(film.rows.words), np.bool_)
    for first in range(0, len(noisy), _ROWS_AT_A_TIME):
        brightness, error = _squares(film.rows.part(first, first + _ROWS_AT_A_TIME), target, least)
        noisy[first : first + _ROWS_AT_A_TIME] = error > brightness
    rows = film.in_rows(_grown(film.in_order(noisy))).astype(np.uint8)
    return rows & before if len(before) else rows


def _squares(rows: FilmRows, target: float, least: float) -> tuple[F64, F64]:
    """Of each row: the square of the error that is allowed, and of the error that is expected; all three channels together."""
    variance = variance_of(rows)
    mean = radiance_of(rows) / np.maximum(rows.samples, 1)[:, None]
    light = mean[:, 0] * mean[:, 0] + mean[:, 1] * mean[:, 1] + mean[:, 2] * mean[:, 2]
    return target * target * np.maximum(light, least * least), variance[:, 0] + variance[:, 1] + variance[:, 2]


def _mean_light(film: Film) -> float:
    """Of all pixels and channels, weighed by their samples: one division of whole numbers, in any order the same."""
    total = samples = 0
    for first in range(0, len(film.rows.words), _ROWS_AT_A_TIME):
        rows = film.rows.part(first, first + _ROWS_AT_A_TIME)
        low = rows.low.astype(np.uint64)
        upper, lower = int((low >> np.uint64(32)).sum(dtype=np.uint64)), int((low & np.uint64(0xFFFFFFFF)).sum(dtype=np.uint64))
        total += (int(rows.high.sum(dtype=np.int64)) << 64) + (upper << 32) + lower
        samples += int(rows.samples.sum(dtype=np.int64))
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
