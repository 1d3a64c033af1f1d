"""How an image is cut for a visual partition: rows of its film, times samples (specs/32-partitions.md, Visual). Pure.

A film's rows stand in the scattered order of pixels, so a run of rows is a fair sample of the image, and no run is much more work than another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from scenefold.base.limits import PASS_PATHS_MAX

RUNS_OF_A_WORKER = 4
"""That there be enough to share out: who is faster takes more of them."""
ROWS_LEAST = 4_096
"""Fewer rays at a time are traced less well;"""
ROWS_MOST = PASS_PATHS_MAX
"""more have no number in their ray's record."""
PATHS_MOST = 1 << 22
"""Of one run: what is lost with a worker is some seconds of its work."""


@dataclass(frozen=True, slots=True)
class Run:
    """Samples of a run of rows."""

    first_row: int
    rows: int
    first_sample: int
    samples: int

    @property
    def paths(self) -> int:
        """How many there are, if all pixels go on."""
        return self.rows * self.samples


def runs_of(rows: int, first_sample: int, last_sample: int, workers: int) -> Iterator[Run]:
    """All samples from the first one up to before the last one of so many rows, each path in one run, for so many workers."""
    assert rows > 0 and 0 <= first_sample < last_sample and workers > 0
    wanted = -(-rows // (workers * RUNS_OF_A_WORKER))
    size = min(max(wanted, ROWS_LEAST), ROWS_MOST)
    samples = max(PATHS_MOST // min(size, rows), 1)
    for first in range(first_sample, last_sample, samples):
        for row in range(0, rows, size):
            yield Run(row, min(size, rows - row), first, min(samples, last_sample - first))
