"""Values between keyframes, as glTF 2.0 defines them (appendix C): steps, straight lines, great circles, cubic splines.

In f64 from + - × ÷ √ alone, so that a file at a moment gives the same records on every machine. A great circle is walked by
halving, each half the sum of two unit quaternions made a unit again: that needs neither sines nor their inverses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Numbers = tuple[float, ...]
_HALVINGS_MAX = 54
"""A share of f64 has no more binary digits above 2^-54, and what is below moves nothing."""
_TURN_LENGTH_MIN = 1e-3


class Interpolation(StrEnum):
    """Between two keyframes."""

    STEP = "STEP"
    LINEAR = "LINEAR"
    CUBICSPLINE = "CUBICSPLINE"


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """How one value moves."""

    times: NDArray[np.float64]
    """f64[n] in seconds, finite, never falling, n ≥ 1."""
    values: NDArray[np.float64]
    """f64[n, 3, w] finite: tangent in, value, tangent out of each keyframe. Tangents are read by splines alone."""
    interpolation: Interpolation
    turns: bool = False
    """Whether the values are quaternions x, y, z, w, none of them 0."""

    def at(self, time_s: float) -> Numbers:
        """The value: that of the first keyframe before it, and of the last one after it. Quaternions are units."""
        after = int(np.searchsorted(self.times, time_s, side="right"))
        if after == 0 or after == len(self.times) or self.interpolation is Interpolation.STEP:
            return self._key(max(after - 1, 0))
        begin, end = float(self.times[after - 1]), float(self.times[after])
        share, step = (time_s - begin) / (end - begin), end - begin
        if self.interpolation is Interpolation.CUBICSPLINE:
            return self._spline(after - 1, share, step)
        first, second = self._key(after - 1), self._key(after)
        if self.turns:
            return between_turns(first, second, share)
        return tuple(a + (b - a) * share for a, b in zip(first, second, strict=True))

    def _key(self, number: int) -> Numbers:
        value: Numbers = tuple(self.values[number, 1].tolist())
        return unit(value) if self.turns else value

    def _spline(self, number: int, t: float, step: float) -> Numbers:
        value, out = self.values[number, 1], self.values[number, 2] * step
        target, into = self.values[number + 1, 1], self.values[number + 1, 0] * step
        cube, square = t * t * t, t * t
        moved = (
            value * (2 * cube - 3 * square + 1) + out * (cube - 2 * square + t) + target * (3 * square - 2 * cube) + into * (cube - square)
        )
        result: Numbers = tuple(moved.tolist())
        if not self.turns:
            return result
        # A spline may pass so near to 0 that it is no rotation: then the keyframe stays.
        return unit(result) if sum(one * one for one in result) > _TURN_LENGTH_MIN**2 else self._key(number)


def unit(vector: Numbers) -> Numbers:
    """The vector, which must not be 0, with length 1."""
    length = math.sqrt(sum(one * one for one in vector))
    return tuple(one / length for one in vector)


def between_turns(first: Numbers, second: Numbers, share: float) -> Numbers:
    """`share` (0 to 1) of the shorter way from one unit quaternion to another, at an even pace."""
    if sum(a * b for a, b in zip(first, second, strict=True)) < 0.0:
        second = tuple(-one for one in second)
    low, high = first, second
    for _ in range(_HALVINGS_MAX):
        if share <= 0.0:
            break
        middle = unit(tuple(a + b for a, b in zip(low, high, strict=True)))
        share *= 2.0
        if share >= 1.0:
            low, share = middle, share - 1.0
        else:
            high = middle
    return low
