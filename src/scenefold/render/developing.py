"""From a film's whole numbers to an image's layers: one division a value, the same bits wherever it is done (specs/08-passes.md, *The image*)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
import numpy.typing as npt

from scenefold.render.arrays import F64
from scenefold.render.film import Film
from scenefold.render.film_rows import FilmRows
from scenefold.render.layers import BEAUTY, KINDS, Pixels, columns_of
from scenefold.render.numbers import diagonal_of
from scenefold.render.sum_columns import (
    ALBEDO,
    AOV_UNIT,
    CHANNELS,
    DEPTH,
    DIRECT,
    EMISSION,
    HIT,
    INDIRECT,
    NORMAL,
    RADIANCE_UNIT,
    SQUARE_UNIT,
    THREE_PARTS,
)

Box = tuple[F64, F64]
"""The job's box: its low and its high end, float64[3]."""
_POSITION = HIT
"""Where the position's sums begin among a row's features: HIT is counted elsewhere."""
_ROWS_AT_A_TIME = 65_536
"""So that what is computed on the way takes little memory beside film and image."""


def develop(film: Film, names: Iterable[str], box: Box, near: float = 0.0) -> dict[str, Pixels]:
    """The beauty and these other layers of a film, whose columns must have been written; top row first.

    near: how far the box is from the camera (numbers.depth_of_box); depths are counted from there.
    """
    names = (BEAUTY, *names)
    assert columns_of(names[1:]).within(film.rows.columns), "a layer whose columns were not written"
    layers = {}
    for name in names:
        kind = KINDS[name]
        values = np.empty((film.width * film.height, len(kind.channels)), kind.dtype.newbyteorder("="))
        for first in range(0, len(values), _ROWS_AT_A_TIME):
            rows = film.rows.part(first, first + _ROWS_AT_A_TIME)
            found = _LAYERS[name](rows, box)
            values[first : first + _ROWS_AT_A_TIME] = found + near if name == "depth" else found
        image = film.in_order(values)
        layers[name] = image if len(kind.channels) > 1 else image[:, :, 0]
    return layers


def _beauty(rows: FilmRows, _box: Box) -> F64:
    return radiance_of(rows) / _counts(rows)


def _part(first: int) -> Callable[[FilmRows, Box], F64]:
    def part(rows: FilmRows, _box: Box) -> F64:
        channels = slice(first, first + CHANNELS)
        return _as_reals(rows.high[:, channels], rows.low[:, channels]) / RADIANCE_UNIT / _counts(rows)

    return part


def _feature(first: int) -> Callable[[FilmRows, Box], F64]:
    def feature(rows: FilmRows, _box: Box) -> F64:
        return rows.features[:, first : first + CHANNELS] / AOV_UNIT / _counts(rows)

    return feature


def _depth(rows: FilmRows, box: Box) -> F64:
    depth: F64 = rows.features[:, DEPTH, None] / AOV_UNIT / _hits(rows) * diagonal_of(*box)
    depth[rows.hits == 0] = np.inf
    return depth


def _position(rows: FilmRows, box: Box) -> F64:
    low, high = box
    position: F64 = low + rows.features[:, _POSITION : _POSITION + CHANNELS] / AOV_UNIT / _hits(rows) * (high - low)
    position[rows.hits == 0] = np.inf
    return position


def _number(column: int) -> Callable[[FilmRows, Box], npt.NDArray[np.int32]]:
    def number(rows: FilmRows, _box: Box) -> npt.NDArray[np.int32]:
        found = rows.first_hits
        return np.where(found[:, :1] != 0, found[:, column : column + 1] + 1, 0)

    return number


def _samples(rows: FilmRows, _box: Box) -> npt.NDArray[np.int32]:
    return rows.samples[:, None]


def _variance(rows: FilmRows, _box: Box) -> F64:
    return variance_of(rows)


_LAYERS: Mapping[str, Callable[[FilmRows, Box], npt.NDArray[np.float64] | npt.NDArray[np.int32]]] = {
    "beauty": _beauty,
    "emission": _part(EMISSION),
    "direct": _part(DIRECT),
    "indirect": _part(INDIRECT),
    "albedo": _feature(ALBEDO),
    "normal": _feature(NORMAL),
    "depth": _depth,
    "position": _position,
    "object_id": _number(1),
    "material_id": _number(2),
    "samples": _samples,
    "variance": _variance,
}
"""Each: rows [n, ...] in, values [n, channels] out."""


def _counts(rows: FilmRows) -> F64:
    """Paths of each row, at least 1, float64[n, 1]."""
    counts: F64 = np.maximum(rows.samples, 1).astype(np.float64)[:, None]
    return counts


def _hits(rows: FilmRows) -> F64:
    hits: F64 = np.maximum(rows.hits, 1).astype(np.float64)[:, None]
    return hits


def radiance_of(rows: FilmRows) -> F64:
    """All light, float64[n, 3]: the parts are added as whole numbers, so it does not matter how many there are."""
    high, low = rows.high[:, :CHANNELS].astype(np.int64), rows.low[:, :CHANNELS]
    for first in range(CHANNELS, rows.columns.radiance, CHANNELS):
        before = low
        low = before + rows.low[:, first : first + CHANNELS]
        high = high + rows.high[:, first : first + CHANNELS] + (low < before)
    return _as_reals(high, low) / RADIANCE_UNIT


def variance_of(rows: FilmRows) -> F64:
    """Of each pixel's mean, float64[n, 3]."""
    counts = _counts(rows)
    mean = radiance_of(rows) / counts
    mean_square = _as_reals(rows.square_high, rows.square_low) / SQUARE_UNIT / counts
    variance: F64 = np.maximum(mean_square - mean * mean, 0.0) / np.maximum(counts - 1.0, 1.0)
    return variance


def _as_reals(high: npt.NDArray[np.int32] | npt.NDArray[np.int64], low: npt.NDArray[np.uint64]) -> F64:
    """96-bit numbers as f64: the same rounding everywhere, whole numbers being converted one limb at a time."""
    reals: F64 = high.astype(np.float64) * 18446744073709551616.0 + low.astype(np.float64)
    return reals


assert set(_LAYERS) == set(KINDS) and INDIRECT + CHANNELS == THREE_PARTS
