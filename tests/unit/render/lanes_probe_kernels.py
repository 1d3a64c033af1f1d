"""One function on numbers and the same on lanes, side by side, so that a test can compare the bits."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from scenefold.render import (
    bsdf_kernels,
    lane_values_kernels,
    lanes_kernels,
    light_kernels,
    math_kernels,
    see_through_kernels,
    space_kernels,
)

_alike, _any_lane, _gather, _lane_of, _select, _with_lane = (
    lane_values_kernels.alike,
    lane_values_kernels.any_lane,
    lane_values_kernels.gather,
    lane_values_kernels.lane_of,
    lane_values_kernels.select,
    lane_values_kernels.with_lane,
)
_no_flags, _no_words, _opposite, _rounded_down, _in_f32 = (
    lane_values_kernels.no_flags,
    lane_values_kernels.no_words,
    lane_values_kernels.opposite,
    lane_values_kernels.rounded_down,
    lane_values_kernels.in_f32,
)
_bits_of, _as_word, _real_of_word, _word_of_real, _f32_of_bits = (
    lane_values_kernels.bits_of,
    lane_values_kernels.as_word,
    lane_values_kernels.real_of_word,
    lane_values_kernels.word_of_real,
    lane_values_kernels.f32_of_bits,
)
_LANES = lanes_kernels.LANES
RESULTS = 11

BOX_LOW, BOX_HIGH = np.array([-1.0, 0.25, -3.0]), np.array([2.0, 0.75, 0.5])
_turns, _code, _direction = math_kernels.sine_cosine_of_turns, math_kernels.encode_direction, math_kernels.decode_direction
_color_code, _color, _pdf_code, _pdf = (
    math_kernels.encode_color,
    math_kernels.decode_color,
    math_kernels.encode_pdf,
    math_kernels.decode_pdf,
)
_key, _uniform = math_kernels.path_key, math_kernels.uniform
_frame, _cosine, _normal, _evaluate, _coat = (
    bsdf_kernels.frame_of,
    bsdf_kernels.sample_cosine,
    bsdf_kernels.sample_visible_normal,
    bsdf_kernels.evaluate,
    bsdf_kernels.coat_probability,
)
_span, _offset = space_kernels.box_span, space_kernels.offset_origin
_passed, _opaque, _light = see_through_kernels.passed_share, see_through_kernels.is_surely_opaque, light_kernels.sample_light


@njit(error_model="numpy")
def operators(a, b, c, d, key):
    """Everything that lanes have of Python."""
    low = (a < b) & (c <= d)
    high = (a > b) | (c >= d)
    same = (a == b) | (c != d)
    word = (_bits_of(a) ^ (key >> np.uint64(3))) * np.uint64(0x9E3779B97F4A7C15) + (key << np.uint64(7)) - np.uint64(5)
    word = (word % np.uint64(1000)) | ((word // np.uint64(3)) & np.uint64(0xFF))
    return (
        a + b * c - d,
        a / b,
        -abs(c) + math.sqrt(d),
        min(a, b) + max(c, d),
        _rounded_down(a * 100.0 - 50.0),
        _in_f32(a * c),
        _select(low & _opposite(high), a, _select(same, 2.0, b)),
        _real_of_word(word),
        _real_of_word(_word_of_real(_rounded_down(d * 1e9))),
        _f32_of_bits(_bits_of(b) & np.uint64(0x3FFFFFFF)),
        1.0 - (2.0 / c),
    )


@njit(error_model="numpy")
def packing(a, b, c, d, key):
    """Codes of the ray record, there and back."""
    sine, cosine = _turns(a)
    u, v = _code(b - 0.5, c - 0.5, d - 0.5)
    x, y, z = _direction(u, v)
    r, g, b_ = _color(_color_code(a * 1e3, b * b, c, key, _as_word(key & np.uint64(7)), 8))
    return sine, cosine, _real_of_word(u), _real_of_word(v), x, y, z, r, g, b_, _pdf(_pdf_code(a / (d * d * d)))


@njit(error_model="numpy")
def dice(a, b, c, d, key):
    """Keys and numbers at random."""
    path = _key(7, 1, key & np.uint64(0xFFFFF), key >> np.uint64(50))
    first, second = _uniform(path, 3, 8), _uniform(path, key & np.uint64(31), 11)
    return first, second, a, b, c, d, a, b, c, d, a


@njit(error_model="numpy")
def surfaces(a, b, c, d, key):
    """What scatters, and how much."""
    wx, wy, wz = _cosine(a, b)
    ix, iy, iz = _cosine(c, d)
    iz = _select(a < 0.1, -iz, iz)
    alpha = max(a * a, 1e-3)
    hx, hy, hz = _normal(wx, wy, wz, alpha, c, d)
    coat = _coat(wz, a, b, c, d, 0.04, _select(b < 0.5, 0.0, b))
    r, g, b_, pdf = _evaluate(wx, wy, wz, ix, iy, iz, a, b, c, d, alpha, 0.04, _select(b < 0.5, 0.0, b), coat)
    passed = _passed(b, 1.0 + c, d, wz) + _select(_opaque(_rounded_down(a * 3.0), 0.5, b, _rounded_down(c * 2.0) - 1.0), 1.0, 0.0)
    return hx, hy, hz, coat, r, g, b_, pdf, passed, ix, iy


@njit(error_model="numpy")
def spaces(a, b, c, d, key):
    """Frames, spans of a box, origins."""
    x, y, z = _direction(*_code(a - 0.5, b - 0.5, c - 0.5))
    x = _select(d < 0.2, 0.0, x)
    ax, ay, az, bx, by, _ = _frame(x, y, z)
    t_in, t_out = _span(a * 4.0 - 2.0, b, c * 5.0 - 3.0, x, y, z, BOX_LOW, BOX_HIGH)
    ox, oy, oz = _offset(a, b, c, x, y, z, 3.0)
    return ax, ay, az, bx, by, t_in, t_out, ox, oy, oz, d


def _beside(function: Any) -> Callable[[Any, Any], tuple[Any, Any]]:
    """(numbers, lanes) of f64[n, 4] and uint64[n]: f64[n, RESULTS] each; n is a multiple of LANES."""

    @njit(error_model="numpy")
    def compare(reals, keys):
        single, many = np.empty((keys.size, RESULTS)), np.empty((keys.size, RESULTS))
        for i in range(keys.size):
            found = function(reals[i, 0], reals[i, 1], reals[i, 2], reals[i, 3], keys[i])
            for column in range(RESULTS):
                single[i, column] = found[column]
        for i in range(0, keys.size, _LANES):
            at = _no_words()
            for lane in range(_LANES):
                at = _with_lane(at, lane, i + lane)
            found = function(
                _gather(reals, (at, 0)), _gather(reals, (at, 1)), _gather(reals, (at, 2)), _gather(reals, (at, 3)), _gather(keys, (at,))
            )
            for column in range(RESULTS):
                for lane in range(_LANES):
                    many[i + lane, column] = _lane_of(found[column], lane)
        return single, many

    found: Callable[[Any, Any], tuple[Any, Any]] = compare
    return found


BESIDE = {function.__name__: _beside(function) for function in (operators, packing, dice, surfaces, spaces)}


@njit(error_model="numpy")
def lights(scene, job, points, keys):
    """Light samples at f64[n, 3], from numbers and from lanes: f64[n, 11] each."""
    single, many = np.empty((keys.size, RESULTS)), np.empty((keys.size, RESULTS))
    for i in range(keys.size):
        found = _light(scene, job, keys[i], np.uint64(2), points[i, 0], points[i, 1], points[i, 2], 0.0, 1.0, 0.0)
        single[i, 0] = found[0]
        for column, value in enumerate(found[1:]):
            single[i, 1 + column] = value
    for i in range(0, keys.size, _LANES):
        at = _no_words()
        for lane in range(_LANES):
            at = _with_lane(at, lane, i + lane)
        zero = _alike(0.0, at)
        found = _light(
            scene, job, _gather(keys, (at,)), _alike(np.uint64(2), at),
            _gather(points, (at, 0)), _gather(points, (at, 1)), _gather(points, (at, 2)), zero, _alike(1.0, at), zero,
        )  # fmt: skip
        for lane in range(_LANES):
            many[i + lane, 0] = _lane_of(found[0], lane)
            for column, value in enumerate(found[1:]):
                many[i + lane, 1 + column] = _lane_of(value, lane)
    return single, many


@njit(error_model="numpy")
def some(flags):
    """Whether any of four flags is set, and how many are, lane by lane."""
    lanes = _no_flags()
    for lane in range(_LANES):
        lanes = _with_lane(lanes, lane, flags[lane])
    count = 0
    for lane in range(_LANES):
        count += int(_lane_of(lanes, lane))
    return _any_lane(lanes), count
