"""How paths are drawn, and what their light may weigh: settings of a render (specs/07-rays.md, *Random numbers*, *Settings of paths*). Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import UsageFault
from scenefold.base.image_limits import CLAMP_MAX, DEPTH_MAX, SAMPLERS
from scenefold.base.plain_values import number, text, whole


@dataclass(frozen=True, slots=True)
class Sampling:
    """The usual values are those of an image that says nothing of it."""

    sampler: str = "sobol"
    """One of `SAMPLERS`."""
    roulette_from: int = 3
    """Bounce from which on a path may end by chance, 1 to `DEPTH_MAX`; from a job's depth on it never does."""
    clamp_direct: float | None = None
    """Most that one contribution of light that was reflected at most once may be, as the mean of its channels; None: anything."""
    clamp_indirect: float | None = None
    """The same of light that was reflected more often."""

    def check(self) -> None:
        """UsageFault naming the first setting that is out of range."""
        if self.sampler not in SAMPLERS:
            raise UsageFault(f"there is no sampler {self.sampler!r:.40}", where="sampler", remedy=f"choose one of {', '.join(SAMPLERS)}")
        if not 1 <= self.roulette_from <= DEPTH_MAX:
            raise UsageFault(
                f"roulette from bounce {self.roulette_from}", where="roulette-from", remedy=f"give a whole number from 1 to {DEPTH_MAX}"
            )
        for name, value in (("clamp-direct", self.clamp_direct), ("clamp-indirect", self.clamp_indirect)):
            if value is not None and not 0.0 < value <= CLAMP_MAX:
                raise UsageFault(f"{name} is {value}", where=name, remedy=f"give a radiance above 0, up to {CLAMP_MAX:.0f}")

    def row(self) -> list[Any]:
        """Plain values."""
        limits = [None if limit is None else float(limit) for limit in (self.clamp_direct, self.clamp_indirect)]
        return [self.sampler, self.roulette_from, *limits]

    @classmethod
    def of_row(cls, row: Any) -> Self:
        """What `row` gave, or the usual for None; ValueError or TypeError for anything else."""
        if row is None:
            return cls()
        sampler, roulette_from, *limits = row
        direct, indirect = (None if limit is None else number(limit) for limit in limits)
        return cls(text(sampler), whole(roulette_from, 0, 1 << 32), direct, indirect)


USUAL_SAMPLING = Sampling()
