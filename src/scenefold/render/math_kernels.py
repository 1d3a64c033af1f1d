"""Arithmetic in lanes that gives the same bits everywhere: only + - * / and square roots (rendering.md, Bits).

Sine, cosine, exp2 and log2 are polynomials of our own in single precision, and the packed forms of the ray record
(directions, colours, densities) are defined here, once (specs/07-rays.md). All functions are device functions,
inlined into the kernels that loop over batches, and take lanes; numbers where they say so.

`_nrt=False`, here and in all kernels that allocate nothing: numba does not count references to the arrays that they
are given (docs/decisions/0005-kernels-count-no-references.md).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.lane_values_kernels import bits_of, real_of_bits, real_of_whole, rounded_down, select, whole_of_real

PI = 3.141592653589793
INVERSE_PI = 0.3183098861837907
_LN2 = 0.6931471805599453
_LOG2_E = 1.4426950408889634


# Elementary functions ------------------------------------------------------------------------------------


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sine_cosine_of_turns(turns):  # type: ignore[no-untyped-def]
    """(sin, cos) of an angle given in whole turns, 0 <= turns <= 1 (lanes, or numbers); error below 2e-7."""
    quarter = rounded_down(turns * 4.0 + 0.5)
    x = (turns - quarter * 0.25) * (2.0 * PI)
    z = x * x
    s = x + x * z * (((-1.0 / 5040.0 + z * (1.0 / 362880.0)) * z + 1.0 / 120.0) * z - 1.0 / 6.0)
    c = 1.0 + z * (((1.0 / 40320.0 * z - 1.0 / 720.0) * z + 1.0 / 24.0) * z - 0.5)
    crosswise = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = select(crosswise, c, s), select(crosswise, s, c)
    sine = select((quarter == 2.0) | (quarter == 3.0), -sine, sine)
    return sine, select((quarter == 1.0) | (quarter == 2.0), -cosine, cosine)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def log2_in_lanes(x):  # type: ignore[no-untyped-def]
    """Base-2 logarithm of a normal positive x; error below 1e-6 and the result's own rounding."""
    bits = bits_of(x)
    exponent = real_of_whole((bits >> np.uint32(23)) & np.uint32(0xFF)) - 127.0
    mantissa = real_of_bits((bits & np.uint32(0x7FFFFF)) | np.uint32(0x3F800000))
    y = (mantissa - 1.4142135623730951) / (mantissa + 1.4142135623730951)
    z = y * y
    p = ((z * (1.0 / 9.0) + 1.0 / 7.0) * z + 1.0 / 5.0) * z + 1.0 / 3.0
    return exponent + (0.5 + (y + y * z * p) * (2.0 * _LOG2_E))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def exp2_in_lanes(x):  # type: ignore[no-untyped-def]
    """2^x for -126 <= x < 127.5; error below 2e-7 of the result."""
    whole = rounded_down(x + 0.5)
    f = (x - whole) * _LN2
    p = (((((f * (1.0 / 5040.0) + 1.0 / 720.0) * f + 1.0 / 120.0) * f + 1.0 / 24.0) * f + 1.0 / 6.0) * f + 0.5) * f + 1.0
    return (p * f + 1.0) * real_of_bits((whole_of_real(whole) + np.uint32(127)) << np.uint32(23))


# Directions: two octahedral coordinates of 32 bits with a sign ---------------------------------------------

_TO_CODE = 2147483648.0
_FROM_CODE = 1.0 / 2147483648.0
_MOST = 1.0 - 2.0**-24


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _coordinate_code(c):  # type: ignore[no-untyped-def]
    # The bounds come first: of a bound and what is no number, the bound is taken. 2^31 - 1 becomes 2^31 when it is read.
    return select(c >= 1.0, np.uint32(0x7FFFFFFF), whole_of_real(max(-1.0, min(_MOST, c)) * _TO_CODE))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _unfolded(u, v, z):  # type: ignore[no-untyped-def]
    """Octahedral coordinates of the other side, where z is below 0."""
    below = z < 0.0
    return (
        select(below, (1.0 - abs(v)) * select(u >= 0.0, 1.0, -1.0), u),
        select(below, (1.0 - abs(u)) * select(v >= 0.0, 1.0, -1.0), v),
    )


@njit(error_model="numpy", _nrt=False, forceinline=True)
def encode_direction(x, y, z):  # type: ignore[no-untyped-def]
    """The octahedral code of a direction of any length > 0: two words. No code is made of what is no number, but some word is."""
    scale = 1.0 / (abs(x) + abs(y) + abs(z))
    u, v = _unfolded(x * scale, y * scale, z)
    return _coordinate_code(u), _coordinate_code(v)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def decode_direction(code_u, code_v):  # type: ignore[no-untyped-def]
    """The unit direction that a code stands for. The code is the truth: never pack the result again."""
    u, v = real_of_whole(code_u) * _FROM_CODE, real_of_whole(code_v) * _FROM_CODE
    z = 1.0 - abs(u) - abs(v)
    u, v = _unfolded(u, v, z)
    scale = 1.0 / math.sqrt(u * u + v * v + z * z)
    return u * scale, v * scale, z * scale


# Colours: three 13-bit mantissas and a shared 9-bit exponent, in a low word of 32 bits and a high one of 16 --

_COLOR_MIN = 2.0**-100
_COLOR_MAX = 8191.0 / 8192.0 * 2.0**126
_CODE_OF_FIELD = np.uint32(256 - 126)
"""An f32 is below 2^(its exponent field - 126); the code counts exponents from -256."""
_SCALE_FIELD = np.uint32(13 + 126 + 127)
_FIELD_OF_CODE = np.uint32(256 + 13 - 127)
_DECODED_MAX = np.uint32(113 + 127)
"""Exponent field of what the mantissas of the largest code are multiplied by."""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def encode_color(r, g, b, noise):  # type: ignore[no-untyped-def]
    """48 bits of a colour >= 0, rounded by three numbers of [0, 1) so that its mean is exact: (low word, high word).

    Up to 2^-100 it becomes 0, too large the largest code; callers count what is not finite before they ask.
    """
    r, g, b = min(_COLOR_MAX, r), min(_COLOR_MAX, g), min(_COLOR_MAX, b)
    largest = max(r, max(g, b))
    field = (bits_of(largest) >> np.uint32(23)) & np.uint32(0xFF)
    scale = real_of_bits((_SCALE_FIELD - field) << np.uint32(23))
    most = rounded_down(max(r * scale + noise[0], max(g * scale + noise[1], b * scale + noise[2])))
    # Where rounding carried into the next power of two, the code one exponent up is as good.
    carried = most > 8191.0
    scale = select(carried, scale * 0.5, scale)
    field = select(carried, field + np.uint32(1), field)
    # Not above 8191, for whatever is carried twice, nor below 0 for what is no number.
    m_r = whole_of_real(max(0.0, min(8191.0, r * scale + noise[0])))
    m_g = whole_of_real(max(0.0, min(8191.0, g * scale + noise[1])))
    m_b = whole_of_real(max(0.0, min(8191.0, b * scale + noise[2])))
    low = m_r | (m_g << np.uint32(13)) | (m_b << np.uint32(26))
    high = (m_b >> np.uint32(6)) | ((field + _CODE_OF_FIELD) << np.uint32(7))
    lit = largest > _COLOR_MIN
    return select(lit, low, np.uint32(0)), select(lit, high, np.uint32(0))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def decode_color(low, high):  # type: ignore[no-untyped-def]
    """The colour of a code. A code that nobody makes, with an exponent outside of what f32 has, is black."""
    mask = np.uint32(0x1FFF)
    field = (high >> np.uint32(7)) - _FIELD_OF_CODE
    scale = select(field <= _DECODED_MAX, real_of_bits((field & np.uint32(0xFF)) << np.uint32(23)), 0.0)
    return (
        real_of_whole(low & mask) * scale,
        real_of_whole((low >> np.uint32(13)) & mask) * scale,
        real_of_whole((low >> np.uint32(26)) | ((high & np.uint32(0x7F)) << np.uint32(6))) * scale,
    )


# Densities: log2 in steps of 1/1024 from -24 ---------------------------------------------------------------

_PDF_MIN = 2.0**-24
_PDF_MAX = 2.0**41


@njit(error_model="numpy", _nrt=False, forceinline=True)
def encode_pdf(pdf):  # type: ignore[no-untyped-def]
    """The 16-bit code of a density per steradian; the ends of the range saturate."""
    code = (log2_in_lanes(max(_PDF_MIN, min(_PDF_MAX, pdf))) + 24.0) * 1024.0 + 0.5
    return whole_of_real(min(code, 65534.0))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def decode_pdf(code):  # type: ignore[no-untyped-def]
    """The density that a code below 65535 stands for."""
    return exp2_in_lanes(real_of_whole(code) * (1.0 / 1024.0) - 24.0)
