"""Adaptive sampling, what a user asks of it: how much noise is little enough, and after how many samples that is asked. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import UsageFault
from scenefold.base.image_limits import ADAPTIVE_MAX, MIN_SAMPLES_LEAST, SAMPLES_MAX
from scenefold.base.plain_values import number, whole

FIRST_LEVEL = 16
"""Samples of each pixel before anything is decided: fewer say too little of a pixel's variance."""


@dataclass(frozen=True, slots=True)
class Adaptive:
    """Pixels whose expected error is at most `noise` times their brightness end before the others."""

    noise: float
    """Standard error of the mean, relative to it."""
    first: int = FIRST_LEVEL
    """Samples that every pixel has, unless the render has fewer in all."""

    def check(self) -> None:
        """UsageFault naming what is out of range."""
        if not (math.isfinite(self.noise) and 0.0 < self.noise <= ADAPTIVE_MAX):
            raise UsageFault(f"adaptive is {self.noise}", where="adaptive", remedy=f"give a number above 0, and up to {ADAPTIVE_MAX:g}")
        if not MIN_SAMPLES_LEAST <= self.first <= SAMPLES_MAX:
            remedy = f"give a whole number from {MIN_SAMPLES_LEAST} to {SAMPLES_MAX}"
            raise UsageFault(f"min_samples is {self.first}", where="min_samples", remedy=remedy)

    def levels(self, samples: int) -> tuple[int, ...]:
        """The counts at which is decided who goes on, and the last one, `samples`, at which all end: 16, 32, 64, …"""
        counts = [self.first]
        while counts[-1] * 2 < samples:
            counts.append(counts[-1] * 2)
        return (*(count for count in counts if count < samples), samples)

    def row(self) -> list[float | int]:
        """Plain values."""
        return [float(self.noise), self.first]

    @classmethod
    def of_row(cls, row: Any) -> Self | None:
        """What `row` gave, or None for None; ValueError or TypeError for anything else, UsageFault for what is out of range."""
        if row is None:
            return None
        noise, first = row
        adaptive = cls(number(noise), whole(first, -(2**63), 2**64 - 1))
        adaptive.check()
        return adaptive


def adaptive_of(noise: float | None, first: int | None) -> Adaptive | None:
    """What two options ask for, None being the usual first level, or no adaptive sampling; UsageFault for a first level alone."""
    if noise is None and first is not None:
        raise UsageFault("min_samples counts with adaptive only", where="min_samples", remedy="give both, or none")
    return None if noise is None else Adaptive(noise, FIRST_LEVEL if first is None else first)
