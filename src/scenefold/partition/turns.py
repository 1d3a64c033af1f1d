"""Angles as fractions of a turn, and their cosine and sine in bits that are the same everywhere.

libm's cos and sin differ in the last digit between machines, and these decide who owns a point: so they are
polynomials from + - x only, on an eighth of a turn. Multiples of a quarter turn come out exactly.
"""

from __future__ import annotations

_TURN = 6.283185307179586
_SINE = (1.0, -1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800, 1 / 6227020800, -1 / 1307674368000, 1 / 355687428096000)
_COSINE = (1.0, -1 / 2, 1 / 24, -1 / 720, 1 / 40320, -1 / 3628800, 1 / 479001600, -1 / 87178291200, 1 / 20922789888000)


def cosine_and_sine(fraction: float) -> tuple[float, float]:
    """Cosine and sine of this fraction of a turn, 0 to 1; wrong by at most about 2^-52."""
    quarter = int(fraction * 4.0 + 0.5)
    angle = (fraction - quarter * 0.25) * _TURN  # the difference is exact
    square = angle * angle
    cosine, sine = _series(_COSINE, square), _series(_SINE, square) * angle
    return ((cosine, sine), (-sine, cosine), (-cosine, -sine), (sine, -cosine))[quarter % 4]


def _series(coefficients: tuple[float, ...], x: float) -> float:
    total = 0.0
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return total
