"""If this fails, a visual partition traces some path twice, or never, or hands out parts that are too large to be lost."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.render.tasks.runs import PATHS_MOST, ROWS_LEAST, RUNS_OF_A_WORKER, runs_of

CUTS = some.tuples(some.integers(1, 60_000), some.integers(0, 40), some.integers(1, 3_000), some.integers(1, 64))


@given(CUTS)
def test_each_path_is_in_one_run(cut: tuple[int, int, int, int]) -> None:
    rows, first, samples, workers = cut
    # In steps of samples that every run begins or ends with: a table of all samples would be large.
    runs = list(runs_of(rows, first, first + samples, workers))
    ends = sorted({run.first_sample for run in runs} | {run.first_sample + run.samples for run in runs})
    assert (ends[0], ends[-1]) == (first, first + samples)
    traced = np.zeros((len(ends) - 1, rows), np.int64)
    for run in runs:
        at, to = ends.index(run.first_sample), ends.index(run.first_sample + run.samples)
        traced[at:to, run.first_row : run.first_row + run.rows] += 1
    assert (traced == 1).all()
    assert sum(run.paths for run in runs) == rows * samples


@given(CUTS)
def test_no_run_is_too_large_or_too_small(cut: tuple[int, int, int, int]) -> None:
    rows, first, samples, workers = cut
    runs = list(runs_of(rows, first, first + samples, workers))
    assert all(run.rows <= PASS_PATHS_MAX and run.rows > 0 and run.samples > 0 for run in runs)
    assert all(run.paths <= max(PATHS_MOST, run.rows) for run in runs)
    assert max(run.rows for run in runs) >= min(rows, ROWS_LEAST)


def test_there_are_enough_for_all_workers() -> None:
    assert len(list(runs_of(640 * 360, 0, 4, 4))) >= 4 * RUNS_OF_A_WORKER
