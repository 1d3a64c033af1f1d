"""Arithmetic on single numbers in double precision: keys of paths, sine and cosine, powers (specs/07-rays.md, Arithmetic).

Only + - * / and square roots, as everywhere that reaches the film: libm, SVML and numpy's transcendentals differ
between machines and versions. What is computed for every hit goes in lanes instead (math_kernels.py).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

PI = 3.141592653589793
_LN2 = 0.6931471805599453
_LOG2_E = 1.4426950408889634
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@intrinsic
def f64_bits(typingctx, value):  # type: ignore[no-untyped-def]
    """The 64 bits of a float64."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], context.get_value_type(types.uint64))

    return types.uint64(types.float64), codegen


@intrinsic
def f64_from_bits(typingctx, value):  # type: ignore[no-untyped-def]
    """The float64 with these 64 bits."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], context.get_value_type(types.float64))

    return types.float64(types.uint64), codegen


@intrinsic
def f32_bits(typingctx, value):  # type: ignore[no-untyped-def]
    """The 32 bits of a float32."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], context.get_value_type(types.uint32))

    return types.uint32(types.float32), codegen


@intrinsic
def f32_from_bits(typingctx, value):  # type: ignore[no-untyped-def]
    """The float32 with these 32 bits."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], context.get_value_type(types.float32))

    return types.float32(types.uint32), codegen


@njit(error_model="numpy", _nrt=False)
def mix64(value):  # type: ignore[no-untyped-def]
    """The finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection of 64 bits that avalanches."""
    value = (value ^ (value >> np.uint64(30))) * _MIX_1
    value = (value ^ (value >> np.uint64(27))) * _MIX_2
    return value ^ (value >> np.uint64(31))


@njit(error_model="numpy", _nrt=False)
def path_key(seed, frame, pixel, sample):  # type: ignore[no-untyped-def]
    """A key of one path, 64 bits: a function of what the path is, never of who traces it or when."""
    key = mix64(np.uint64(seed) + _GOLDEN)
    key = mix64(key ^ (np.uint64(frame) * _GOLDEN))
    return mix64(key + ((np.uint64(pixel) << np.uint64(32)) | np.uint64(sample)) * _GOLDEN)


@njit(error_model="numpy", _nrt=False)
def _sin_small(x):  # type: ignore[no-untyped-def]
    """sin on |x| <= pi/4, Taylor to x^15: error below 1e-16."""
    z = x * x
    p = -1.0 / 1307674368000.0
    p = p * z + 1.0 / 6227020800.0
    p = p * z - 1.0 / 39916800.0
    p = p * z + 1.0 / 362880.0
    p = p * z - 1.0 / 5040.0
    p = p * z + 1.0 / 120.0
    p = p * z - 1.0 / 6.0
    return x + x * z * p


@njit(error_model="numpy", _nrt=False)
def _cos_small(x):  # type: ignore[no-untyped-def]
    """cos on |x| <= pi/4, Taylor to x^16."""
    z = x * x
    p = 1.0 / 20922789888000.0
    p = p * z - 1.0 / 87178291200.0
    p = p * z + 1.0 / 479001600.0
    p = p * z - 1.0 / 3628800.0
    p = p * z + 1.0 / 40320.0
    p = p * z - 1.0 / 720.0
    p = p * z + 1.0 / 24.0
    p = p * z - 0.5
    return 1.0 + z * p


@njit(error_model="numpy", _nrt=False)
def sine_cosine_of(turns):  # type: ignore[no-untyped-def]
    """(sin, cos) of an angle in whole turns, 0 <= turns <= 1."""
    quarter = math.floor(turns * 4.0 + 0.5)
    rest = (turns - quarter * 0.25) * (2.0 * PI)
    s, c = _sin_small(rest), _cos_small(rest)
    if quarter == 1.0:
        return c, -s
    if quarter == 2.0:
        return -s, -c
    if quarter == 3.0:
        return -c, s
    return s, c


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def sine_cosine(radians):  # type: ignore[no-untyped-def]
    """(sin, cos) of an angle, 0 <= radians <= 2 pi."""
    return sine_cosine_of(radians / (2.0 * PI))


@njit(error_model="numpy", _nrt=False)
def log2_of(x):  # type: ignore[no-untyped-def]
    """Base-2 logarithm of a normal positive x; error below 1e-15 relative to the result's scale."""
    bits = f64_bits(x)
    exponent = int((bits >> np.uint64(52)) & np.uint64(0x7FF)) - 1023
    mantissa = f64_from_bits((bits & np.uint64(0x000FFFFFFFFFFFFF)) | np.uint64(0x3FF0000000000000))
    if mantissa > 1.4142135623730951:
        mantissa *= 0.5
        exponent += 1
    y = (mantissa - 1.0) / (mantissa + 1.0)
    z = y * y
    p = 1.0 / 23.0
    p = p * z + 1.0 / 21.0
    p = p * z + 1.0 / 19.0
    p = p * z + 1.0 / 17.0
    p = p * z + 1.0 / 15.0
    p = p * z + 1.0 / 13.0
    p = p * z + 1.0 / 11.0
    p = p * z + 1.0 / 9.0
    p = p * z + 1.0 / 7.0
    p = p * z + 1.0 / 5.0
    p = p * z + 1.0 / 3.0
    p = p * z + 1.0
    return exponent + 2.0 * y * p * _LOG2_E


@njit(error_model="numpy", _nrt=False)
def exp2_of(x):  # type: ignore[no-untyped-def]
    """2^x for -1000 <= x <= 1000."""
    whole = math.floor(x + 0.5)
    f = (x - whole) * _LN2
    p = 1.0 / 87178291200.0
    p = p * f + 1.0 / 6227020800.0
    p = p * f + 1.0 / 479001600.0
    p = p * f + 1.0 / 39916800.0
    p = p * f + 1.0 / 3628800.0
    p = p * f + 1.0 / 362880.0
    p = p * f + 1.0 / 40320.0
    p = p * f + 1.0 / 5040.0
    p = p * f + 1.0 / 720.0
    p = p * f + 1.0 / 120.0
    p = p * f + 1.0 / 24.0
    p = p * f + 1.0 / 6.0
    p = p * f + 0.5
    p = p * f + 1.0
    p = p * f + 1.0
    return p * f64_from_bits(np.uint64(int(whole) + 1023) << np.uint64(52))


@njit(error_model="numpy", _nrt=False)
def power_of(base, exponent):  # type: ignore[no-untyped-def]
    """base^exponent for base >= 0; 0 for base 0."""
    if base <= 0.0:
        return 0.0
    return exp2_of(exponent * log2_of(base))
