"""Passes: a job's paths, cut into pieces that open, balance and close one by one (rendering.md, Passes).

Path number n of a job is one sample of one pixel (generate_kernels.py says which); pass p holds the numbers
p x 65,536 up to the next pass. Whose a pass is, follows from a hash of job and pass: nobody assigns passes.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.base.location import LOCATION_BYTES, Location


@dataclass(frozen=True, slots=True)
class PassPlan:
    """All passes of one job."""

    job: int
    """The job's id, 64 bits."""
    paths: int
    """width x height x samples."""

    @property
    def count(self) -> int:
        """How many passes there are."""
        return -(-self.paths // PASS_PATHS_MAX)

    def first_path(self, number: int) -> int:
        """The number of a pass's path 0 among all paths of the job."""
        return number * PASS_PATHS_MAX

    def size(self, number: int) -> int:
        """How many paths a pass has."""
        return min(PASS_PATHS_MAX, self.paths - self.first_path(number))

    def location(self, number: int) -> Location:
        """The place on the line whose owner opens and closes this pass."""
        return place_of(b"pass", self.job, number)


def place_of(what: bytes, job: int, number: int = 0) -> Location:
    """A place on the line that all nodes compute alike: a hash of what, job and number."""
    digest = hashlib.sha256(b"scenefold/" + what + job.to_bytes(8, "big") + number.to_bytes(8, "big")).digest()
    return Location(digest[:LOCATION_BYTES])
