"""Numbers as float64 has them, n · 2^e, whose sums and products are exact; rounded once, when somebody reads them.

What a log adds up to must not depend on how far a space was away meanwhile: 0.3 + 1e15 - 1e15 is 0.3, and not 0.25.
Fractions would do, but reducing one takes a greatest common divisor each time; here a shift does it.

Every scale adds its own bits, so a number has an end (BITS_MAX), or a log would fold the slower the longer it is. It lies
far beyond what sums of float64 need, which are exact for ever.
"""

from __future__ import annotations

import math
from typing import NamedTuple

BITS_MAX = 8_192
"""Of a numerator. Sums of float64 take 2,098, and one more each time that their number doubles."""


class Dyadic(NamedTuple):
    """numerator · 2^exponent; the numerator is odd and has at most BITS_MAX bits, or is 0 with exponent 0."""

    numerator: int
    exponent: int

    @classmethod
    def of(cls, value: float) -> Dyadic:
        """Exactly this float; it is finite."""
        numerator, denominator = value.as_integer_ratio()
        return _reduced(numerator, 1 - denominator.bit_length())

    def plus(self, other: Dyadic) -> Dyadic:
        low = min(self.exponent, other.exponent)
        return _reduced((self.numerator << self.exponent - low) + (other.numerator << other.exponent - low), low)

    def times(self, other: Dyadic) -> Dyadic:
        return _reduced(self.numerator * other.numerator, self.exponent + other.exponent)

    def rounded(self) -> float:
        """The nearest float, ties to even; an infinite one beyond their range."""
        try:
            if self.exponent >= 0:
                return float(self.numerator << self.exponent)
            # Division of whole numbers rounds once, below the normal numbers, too.
            return self.numerator / (1 << -self.exponent)
        except OverflowError:
            return math.inf if self.numerator > 0 else -math.inf


def _reduced(numerator: int, exponent: int) -> Dyadic:
    if not numerator:
        return Dyadic(0, 0)
    surplus = numerator.bit_length() - BITS_MAX
    if surplus > 0:
        numerator, exponent = _halved(numerator, surplus), exponent + surplus
    zeros = (numerator & -numerator).bit_length() - 1
    return Dyadic(numerator >> zeros, exponent + zeros)


def _halved(numerator: int, times: int) -> int:
    """The nearest whole number to numerator / 2^times, ties to even."""
    below, rest = numerator >> times, numerator & ((1 << times) - 1)
    half = 1 << times - 1
    return below + (rest > half or (rest == half and below & 1))
