"""Numbers as float64 has them, n · 2^e, whose sums and products are exact; rounded once, when somebody reads them.

What a log adds up to must not depend on how far a space was away meanwhile: 0.3 + 1e15 - 1e15 is 0.3, and not 0.25.
Fractions would do, but reducing one takes a greatest common divisor each time; here a shift does it.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Dyadic(NamedTuple):
    """numerator · 2^exponent; the numerator is odd, or 0 with exponent 0."""

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
    zeros = (numerator & -numerator).bit_length() - 1
    return Dyadic(numerator >> zeros, exponent + zeros)
