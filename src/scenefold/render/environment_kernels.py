"""The environment map: which radiance comes from a direction, and directions drawn by it (specs/07-rays.md, *Environment*).

Texels are interpolated; a direction is drawn by first a row and then a column of them, evenly within the texel, with probabilities in the
measure of solid angle. Where the tables know no difference (2^-24) a texel is never drawn, and only paths that meet it show it.
All of it in lanes, but the tables, which are made once a job (after Pharr, Jakob and Humphreys, Physically Based Rendering, 4th edition, 12.5).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.bsdf_kernels import luminance
from scenefold.render.lane_values_kernels import alike, gather, real_of_whole, rounded_down, select, whole_of_real
from scenefold.render.math_kernels import sine_cosine_of_turns
from scenefold.render.precise_kernels import sine_cosine

_STEPS = 16777216.0
"""Of probabilities: what random numbers are multiples of."""
_INVERSE_SPHERE = 1.0 / (2.0 * 3.141592653589793 * 3.141592653589793)
_SINE_MIN = 1e-6


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def fill_tables(texels, sums, rows, columns):  # type: ignore[no-untyped-def]
    """Cumulative probabilities of rows, and of columns in each row; all of them multiples of 2^-24, from 0 to 1.

    texels float32[h, w, 3]; sums float64[h] to work in; rows float32[h + 1] and columns float32[h, w + 1] are written.
    """
    height, width = texels.shape[0], texels.shape[1]
    total = 0.0
    for row in range(height):
        sums[row] = 0.0
        for column in range(width):
            sums[row] += _weight(texels, row, column)
        reached = 0.0
        columns[row, 0] = np.float32(0.0)
        for column in range(width):
            reached += _weight(texels, row, column)
            share = reached / sums[row] if sums[row] > 0.0 else (column + 1.0) / width
            columns[row, column + 1] = np.float32(math.floor(share * _STEPS + 0.5) / _STEPS)
        sums[row] *= sine_cosine((row + 0.5) / height * math.pi)[0]
        total += sums[row]
    reached = 0.0
    rows[0] = np.float32(0.0)
    for row in range(height):
        reached += sums[row]
        share = reached / total if total > 0.0 else (row + 1.0) / height
        rows[row + 1] = np.float32(math.floor(share * _STEPS + 0.5) / _STEPS)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _weight(texels, row, column):  # type: ignore[no-untyped-def]
    """Mean luminance of what interpolation makes of a texel and the eight about it: each side has 1/8, the middle 6/8."""
    height, width = texels.shape[0], texels.shape[1]
    found = 0.0
    for down in range(-1, 2):
        y = min(max(row + down, 0), height - 1)
        for right in range(-1, 2):
            x = (column + right + width) % width
            part = (0.75 if down == 0 else 0.125) * (0.75 if right == 0 else 0.125)
            found += part * luminance(np.float64(texels[y, x, 0]), np.float64(texels[y, x, 1]), np.float64(texels[y, x, 2]))
    return found


@njit(error_model="numpy", _nrt=False, forceinline=True)
def turns_of(y, x):  # type: ignore[no-untyped-def]
    """The angle of (x, y) in whole turns, -1/2 to 1/2; error below 2e-7. Of (0, 0) it is 0."""
    steep = abs(y) > abs(x)
    most, least = select(steep, abs(y), abs(x)), select(steep, abs(x), abs(y))
    t = least / select(most == 0.0, 1.0, most)
    z = t * t
    p = (((0.0010841101 * z - 0.0053482119) * z + 0.0126724196) * z - 0.0210614703) * z + 0.0315251042
    turns = t * ((p * z - 0.0530262367) * z + 0.1591543242)
    turns = select(steep, 0.25 - turns, turns)
    turns = select(x < 0.0, 0.5 - turns, turns)
    return select(y < 0.0, -turns, turns)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _interpolated(texels, x, y):  # type: ignore[no-untyped-def]
    """Radiance at a place of the map in texels from its upper left corner; it goes on at the sides, and ends at the poles."""
    height, width = texels.shape[0], texels.shape[1]
    left, above = rounded_down(x - 0.5), rounded_down(y - 0.5)
    along, down = x - 0.5 - left, y - 0.5 - above
    right = left + 1.0
    x0 = whole_of_real(max(0.0, min(select(left < 0.0, left + width, left), width - 1.0)))
    x1 = whole_of_real(max(0.0, min(select(right >= width, right - width, right), width - 1.0)))
    y0 = whole_of_real(max(0.0, min(above, height - 1.0)))
    y1 = whole_of_real(max(0.0, min(above + 1.0, height - 1.0)))
    a, b, c, d = (1.0 - along) * (1.0 - down), along * (1.0 - down), (1.0 - along) * down, along * down
    return (
        a * gather(texels, (y0, x0, 0))
        + b * gather(texels, (y0, x1, 0))
        + c * gather(texels, (y1, x0, 0))
        + d * gather(texels, (y1, x1, 0)),
        a * gather(texels, (y0, x0, 1))
        + b * gather(texels, (y0, x1, 1))
        + c * gather(texels, (y1, x0, 1))
        + d * gather(texels, (y1, x1, 1)),
        a * gather(texels, (y0, x0, 2))
        + b * gather(texels, (y0, x1, 2))
        + c * gather(texels, (y1, x0, 2))
        + d * gather(texels, (y1, x1, 2)),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def environment_at(scene, job, wx, wy, wz):  # type: ignore[no-untyped-def]
    """(r, g, b, pdf): radiance from a unit direction, and the density per steradian with which `sample_environment` draws it."""
    texels, rows, columns = scene.environment, scene.environment_rows, scene.environment_columns
    height, width = texels.shape[0], texels.shape[1]
    mx, mz = job.environment_cosine * wx - job.environment_sine * wz, job.environment_sine * wx + job.environment_cosine * wz
    flat = math.sqrt(mx * mx + mz * mz)
    x = (turns_of(mx, -mz) + 0.5) * width
    y = turns_of(flat, wy) * (2.0 * height)
    r, g, b = _interpolated(texels, x, y)
    column = whole_of_real(max(0.0, min(rounded_down(x), width - 1.0)))
    row = whole_of_real(max(0.0, min(rounded_down(y), height - 1.0)))
    one = np.uint32(1)
    share = gather(columns, (row, column + one)) - gather(columns, (row, column))
    share = share * (gather(rows, (row + one,)) - gather(rows, (row,)))
    return r, g, b, share * (width * height * _INVERSE_SPHERE) / max(flat, _SINE_MIN)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sample_environment(scene, job, u, v):  # type: ignore[no-untyped-def]
    """(wx, wy, wz, r, g, b, pdf): a direction drawn by the map from two numbers in [0, 1), its radiance and its density per steradian."""
    texels, rows, columns = scene.environment, scene.environment_rows, scene.environment_columns
    height, width = texels.shape[0], texels.shape[1]
    one = np.uint32(1)
    row = alike(np.uint32(0), u)
    left = height
    while left > 1:
        half = left // 2
        row = select(gather(rows, (row + np.uint32(half),)) <= v, row + np.uint32(half), row)
        left -= half
    low = gather(rows, (row,))
    row_share = gather(rows, (row + one,)) - low
    column = alike(np.uint32(0), u)
    left = width
    while left > 1:
        half = left // 2
        column = select(gather(columns, (row, column + np.uint32(half))) <= u, column + np.uint32(half), column)
        left -= half
    near = gather(columns, (row, column))
    column_share = gather(columns, (row, column + one)) - near
    x = real_of_whole(column) + (u - near) / column_share
    y = real_of_whole(row) + (v - low) / row_share
    r, g, b = _interpolated(texels, x, y)
    sine, cosine = sine_cosine_of_turns(y * (0.5 / height))
    s, c = sine_cosine_of_turns(x * (1.0 / width))
    mx, mz = -sine * s, sine * c
    wx, wz = job.environment_cosine * mx + job.environment_sine * mz, job.environment_cosine * mz - job.environment_sine * mx
    pdf = row_share * column_share * (width * height * _INVERSE_SPHERE) / max(sine, _SINE_MIN)
    return wx, cosine, wz, r, g, b, pdf
