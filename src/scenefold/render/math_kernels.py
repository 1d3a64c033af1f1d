"""Arithmetic that gives the same bits everywhere: only + - * / and square roots (rendering.md, Bits).

libm, SVML and numpy's transcendentals differ between machines and versions, and a sum over a batch depends
on its length; so sine, cosine, exp2 and log2 are polynomials of our own, random numbers are hashes of what
they are for, and the packed forms of the ray record (directions, throughput, pdf) are defined here, once.
All functions are device functions, inlined into the kernels that loop over batches; what the shader uses takes lanes as well as numbers (lanes_kernels.py).

`_nrt=False`, here and in all kernels that allocate nothing: numba does not count references to the arrays that they
are given (docs/decisions/0005-kernels-count-no-references.md).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from scenefold.render.lane_values_kernels import as_word, bits_of, gather, real_of_bits, real_of_word, rounded_down, select, word_of_real

PI = 3.141592653589793
INVERSE_PI = 0.3183098861837907
LN2 = 0.6931471805599453
LOG2_E = 1.4426950408889634

_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_U32 = np.uint64(0xFFFFFFFF)
_TWO_TO_MINUS_52 = 1.0 / 4503599627370496.0
_TWO_TO_MINUS_53 = 1.0 / 9007199254740992.0


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


# Random numbers ------------------------------------------------------------------------------------------


@njit(error_model="numpy", _nrt=False)
def mix64(value):  # type: ignore[no-untyped-def]
    """The finaliser of splitmix64 (Steele, Lea, Flood 2014): a bijection of 64 bits that avalanches."""
    value = (value ^ (value >> np.uint64(30))) * _MIX_1
    value = (value ^ (value >> np.uint64(27))) * _MIX_2
    return value ^ (value >> np.uint64(31))


@njit(error_model="numpy", _nrt=False)
def path_key(seed, frame, pixel, sample):  # type: ignore[no-untyped-def]
    """The key of one path: a function of what the path is, never of who traces it or when."""
    key = mix64(np.uint64(seed) + _GOLDEN)
    key = mix64(key ^ (np.uint64(frame) * _GOLDEN))
    return mix64(key + ((as_word(pixel) << np.uint64(32)) | as_word(sample)) * _GOLDEN)


@njit(error_model="numpy", _nrt=False)
def uniform(key, bounce, dimension):  # type: ignore[no-untyped-def]
    """A number in [0, 1), of 53 bits, for one dimension of one bounce of a path."""
    counter = as_word(bounce) * np.uint64(64) + np.uint64(dimension) + np.uint64(1)
    word = mix64(key + counter * _GOLDEN) >> np.uint64(11)
    return real_of_word(word >> np.uint64(1)) * _TWO_TO_MINUS_52 + real_of_word(word & np.uint64(1)) * _TWO_TO_MINUS_53


# Elementary functions ------------------------------------------------------------------------------------


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
def sine_cosine_of_turns(turns):  # type: ignore[no-untyped-def]
    """(sin, cos) of an angle given in whole turns, 0 <= turns <= 1."""
    quarter = rounded_down(turns * 4.0 + 0.5)
    rest = (turns - quarter * 0.25) * (2.0 * PI)
    s, c = _sin_small(rest), _cos_small(rest)
    crosswise = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = select(crosswise, c, s), select(crosswise, s, c)
    sine = select((quarter == 2.0) | (quarter == 3.0), -sine, sine)
    return sine, select((quarter == 1.0) | (quarter == 2.0), -cosine, cosine)


@njit(error_model="numpy", _nrt=False)
def log2_of(x):  # type: ignore[no-untyped-def]
    """Base-2 logarithm of a normal positive x; error below 1e-15 relative to the result's scale."""
    bits = bits_of(x)
    exponent = int((bits >> np.uint64(52)) & np.uint64(0x7FF)) - 1023
    mantissa = real_of_bits((bits & np.uint64(0x000FFFFFFFFFFFFF)) | np.uint64(0x3FF0000000000000))
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
    return exponent + 2.0 * y * p * LOG2_E


@njit(error_model="numpy", _nrt=False)
def exp2_of(x):  # type: ignore[no-untyped-def]
    """2^x for -1000 <= x <= 1000."""
    whole = math.floor(x + 0.5)
    f = (x - whole) * LN2
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
    return p * real_of_bits(np.uint64(int(whole) + 1023) << np.uint64(52))


@njit(error_model="numpy", _nrt=False)
def power_of(base, exponent):  # type: ignore[no-untyped-def]
    """base^exponent for base >= 0; 0 for base 0."""
    if base <= 0.0:
        return 0.0
    return exp2_of(exponent * log2_of(base))


# Directions: two 32-bit octahedral coordinates -----------------------------------------------------------


@njit(error_model="numpy", _nrt=False)
def _coordinate_code(x):  # type: ignore[no-untyped-def]
    return word_of_real(min(max(rounded_down((x * 0.5 + 0.5) * 4294967295.0 + 0.5), 0.0), 4294967295.0))


@njit(error_model="numpy", _nrt=False)
def _unfolded(u, v, z):  # type: ignore[no-untyped-def]
    """Octahedral coordinates of the other side, where z is below 0."""
    below = z < 0.0
    return (
        select(below, (1.0 - abs(v)) * select(u >= 0.0, 1.0, -1.0), u),
        select(below, (1.0 - abs(u)) * select(v >= 0.0, 1.0, -1.0), v),
    )


@njit(error_model="numpy", _nrt=False)
def encode_direction(x, y, z):  # type: ignore[no-untyped-def]
    """The octahedral code of a direction of any length > 0: two words below 2^32."""
    scale = 1.0 / (abs(x) + abs(y) + abs(z))
    u, v = _unfolded(x * scale, y * scale, z)
    return _coordinate_code(u), _coordinate_code(v)


@njit(error_model="numpy", _nrt=False)
def decode_direction(code_u, code_v):  # type: ignore[no-untyped-def]
    """The unit direction (f64) that a code stands for. The code is the truth: never pack the result again."""
    u = real_of_word(as_word(code_u)) * (2.0 / 4294967295.0) - 1.0
    v = real_of_word(as_word(code_v)) * (2.0 / 4294967295.0) - 1.0
    z = 1.0 - abs(u) - abs(v)
    u, v = _unfolded(u, v, z)
    scale = 1.0 / math.sqrt(u * u + v * v + z * z)
    return u * scale, v * scale, z * scale


# Throughput: three 13-bit mantissas and a shared 9-bit exponent -------------------------------------------

_EXPONENT_BIAS = 256
_COLOR_MAX = 8191.0 / 8192.0 * 2.0**255
_EXPONENT_MASK = np.uint64(0x7FF)
_F64_BIAS = 1022
"""Of an f64's exponent field, counted so that a number is below 2^(field - bias)."""
_FIELD_MAX = np.uint64(254 + _F64_BIAS)
_SCALE_FIELD = np.uint64(13 + 1023 + _F64_BIAS)
_CODE_OF_FIELD = np.uint64(_F64_BIAS - _EXPONENT_BIAS)
_FIELD_OF_CODE = np.uint64(1023 - 13 - _EXPONENT_BIAS)
_FRACTION = np.uint64(52)


@njit(error_model="numpy", _nrt=False)
def encode_color(r, g, b, key, bounce, dimension):  # type: ignore[no-untyped-def]
    """48 bits of a colour >= 0, rounded at random so that its mean is exact; `dimension` to +2 are used.

    Too small becomes 0, too large the largest code; callers count what is not finite before they ask.
    """
    r, g, b = min(r, _COLOR_MAX), min(g, _COLOR_MAX), min(b, _COLOR_MAX)
    largest = max(r, max(g, b))
    field = (bits_of(largest) >> _FRACTION) & _EXPONENT_MASK
    field = select(field > _FIELD_MAX, _FIELD_MAX, field)
    scale = real_of_bits((_SCALE_FIELD - field) << _FRACTION)
    u_r, u_g, u_b = uniform(key, bounce, dimension), uniform(key, bounce, dimension + 1), uniform(key, bounce, dimension + 2)
    most = max(rounded_down(r * scale + u_r), max(rounded_down(g * scale + u_g), rounded_down(b * scale + u_b)))
    # Where rounding carried into the next power of two, the code one exponent up is as good.
    carried = most > 8191.0
    scale = select(carried, scale * 0.5, scale)
    field = select(carried, field + np.uint64(1), field)
    m_r, m_g, m_b = rounded_down(r * scale + u_r), rounded_down(g * scale + u_g), rounded_down(b * scale + u_b)
    code = (
        word_of_real(min(m_r, 8191.0))
        | (word_of_real(min(m_g, 8191.0)) << np.uint64(13))
        | (word_of_real(min(m_b, 8191.0)) << np.uint64(26))
        | ((field - _CODE_OF_FIELD) << np.uint64(39))
    )
    return select(largest > 1e-70, code, np.uint64(0))


@njit(error_model="numpy", _nrt=False)
def decode_color(code):  # type: ignore[no-untyped-def]
    """The colour (f64) of a 48-bit code."""
    mask = np.uint64(0x1FFF)
    scale = real_of_bits((((code >> np.uint64(39)) & np.uint64(0x1FF)) + _FIELD_OF_CODE) << _FRACTION)
    return (
        real_of_word(code & mask) * scale,
        real_of_word((code >> np.uint64(13)) & mask) * scale,
        real_of_word((code >> np.uint64(26)) & mask) * scale,
    )


# Densities: log2 in steps of 1/1024 from -24 ---------------------------------------------------------------


def _steps_of_two() -> list[float]:
    """2^(i / 1024) for i = 0..1023, by square roots and products alone: the same bits on every machine."""
    roots = [2.0]
    for _ in range(10):
        roots.append(math.sqrt(roots[-1]))
    steps = [1.0]
    for step in range(1, 1024):
        lowest = step & -step
        steps.append(steps[step - lowest] * roots[11 - lowest.bit_length()])
    return steps


_STEPS_OF_TWO = np.array(_steps_of_two())


@njit(error_model="numpy", _nrt=False)
def encode_pdf(pdf):  # type: ignore[no-untyped-def]
    """The 16-bit code of a density per steradian; the ends of the range saturate.

    A shorter logarithm than `log2_of`, around the middle of an octave: its error, 1e-12, is far below a step.
    """
    bits = bits_of(pdf)
    exponent = real_of_word((bits >> _FRACTION) & _EXPONENT_MASK) - 1023.0
    mantissa = real_of_bits((bits & np.uint64(0x000FFFFFFFFFFFFF)) | np.uint64(0x3FF0000000000000))
    y = (mantissa - 1.4142135623730951) / (mantissa + 1.4142135623730951)
    z = y * y
    zz = z * z
    p = (z * (1.0 / 5.0) + 1.0 / 3.0) + zz * (z * (1.0 / 9.0) + 1.0 / 7.0) + zz * zz * (z * (1.0 / 13.0) + 1.0 / 11.0)
    logarithm = 0.5 + (y + y * z * p) * (2.0 * LOG2_E)
    code = rounded_down((logarithm + (exponent + 24.0)) * 1024.0 + 0.5)
    return word_of_real(select(pdf > 5.960464477539063e-08, min(code, 65534.0), 0.0))


@njit(error_model="numpy", _nrt=False)
def decode_pdf(code):  # type: ignore[no-untyped-def]
    """The density that a code below 65535 stands for."""
    code = as_word(code)
    step = gather(_STEPS_OF_TWO, (code & np.uint64(1023),))
    return step * real_of_bits(((code >> np.uint64(10)) + np.uint64(1023 - 24)) << _FRACTION)
