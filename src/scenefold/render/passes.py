"""Passes: a job's paths, cut into pieces that open, balance and close one by one (rendering.md, Passes).

Path number n of a job is one sample of one pixel (generate_kernels.py says which); pass p holds the numbers
p x 65,536 up to the next pass. Whose a pass is, follows from a hash of job and pass: nobody assigns passes.
With adaptive sampling the paths are cut into levels, and each level into passes, whose last may be shorter: no pass has paths of two levels.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np
import numpy.typing as npt

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.render.levels import Adaptive


@dataclass(frozen=True, slots=True)
class PassPlan:
    """All passes of one job."""

    job: int
    """The job's id, 64 bits."""
    paths: int
    """width x height x samples."""
    inner_ends: tuple[int, ...] = ()
    """The numbers of the paths with which the levels after the first one begin, ascending."""

    @property
    def levels(self) -> int:
        """How many there are, one at least."""
        return len(self.inner_ends) + 1

    @property
    def count(self) -> int:
        """How many passes there are."""
        return self.passes_until(self.levels - 1)

    def passes_until(self, level: int) -> int:
        """How many passes the levels up to this one have, itself included."""
        return self._last_passes()[level]

    def first_path(self, number: int) -> int:
        """The number of a pass's path 0 among all paths of the job."""
        level, before = self._level_of(number)
        return (0, *self.inner_ends)[level] + (number - before) * PASS_PATHS_MAX

    def size(self, number: int) -> int:
        """How many paths a pass has."""
        level, _ = self._level_of(number)
        return min(PASS_PATHS_MAX, (*self.inner_ends, self.paths)[level] - self.first_path(number))

    def sizes(self, numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """The same of several, i64[n]."""
        ends, before = np.array((0, *self.inner_ends, self.paths)), np.array((0, *self._last_passes()))
        level = np.searchsorted(before[1:], numbers, side="right")
        first = ends[level] + (numbers - before[level]) * PASS_PATHS_MAX
        sizes: npt.NDArray[np.int64] = np.minimum(PASS_PATHS_MAX, ends[level + 1] - first)
        return sizes

    def level_of(self, number: int) -> int:
        """The level that a pass is of."""
        return self._level_of(number)[0]

    def _level_of(self, number: int) -> tuple[int, int]:
        """The level of a pass, and how many passes come before that."""
        lasts = self._last_passes()
        level = min(bisect_right(lasts, number), len(lasts) - 1)
        return level, lasts[level - 1] if level else 0

    def _last_passes(self) -> list[int]:
        ends = (0, *self.inner_ends, self.paths)
        return list(accumulate(-((first - last) // PASS_PATHS_MAX) for first, last in pairwise(ends)))

    def location(self, number: int) -> Location:
        """The place on the line whose owner opens and closes this pass."""
        return place_of(b"pass", self.job, number)


def plan_of(job: int, pixels: int, samples: int, adaptive: Adaptive | None) -> PassPlan:
    """The passes of a job that makes this many pixels."""
    levels = () if adaptive is None else adaptive.levels(samples)[:-1]
    return PassPlan(job, pixels * samples, tuple(pixels * level for level in levels))


def place_of(what: bytes, job: int, number: int = 0) -> Location:
    """A place on the line that all nodes compute alike: a hash of what, job and number."""
    digest = hashlib.sha256(b"scenefold/" + what + job.to_bytes(8, "big") + number.to_bytes(8, "big")).digest()
    return Location(digest[:LOCATION_BYTES])
