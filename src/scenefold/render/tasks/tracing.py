"""Tracing where the whole scene is held: no ray leaves, so a path is traced to its end by the thread that began it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scenefold.render.adaptive import going_on
from scenefold.render.contract import Tracer
from scenefold.render.film import EVERY_ROW, Film, GoesOn
from scenefold.render.film_kernels import add_pass
from scenefold.render.film_rows import FilmRows
from scenefold.render.job import Job
from scenefold.render.levels import Adaptive
from scenefold.render.pass_sums import PassSums
from scenefold.render.tasks.runs import Run, runs_of
from scenefold.render.tasks.work import Use

PIECE_RAYS = 16_384
"""Handed to a tracer at a time: what it needs for them is a few MiB."""


def rows_of(tracer: Tracer, job: Job, run: Run, goes_on: bytes, use: Use, check: Callable[[], None]) -> FilmRows:
    """The rows of a run, of the samples that it has. `use`: is added to. `check`: called before each sample, and may raise."""
    pixels, columns = job.window.pixels, job.columns
    # A copy: for a table that cannot be written kernels would be compiled once more.
    chosen = np.frombuffer(goes_on, np.uint8).copy()
    assert len(chosen) in (0, run.rows), "a byte for each row"
    rows = FilmRows.zeros(run.rows, columns)
    sums = PassSums.zeros(run.rows, columns)
    for sample in range(run.first_sample, run.first_sample + run.samples):
        check()
        _trace(tracer, sample * pixels + run.first_row, chosen, sums, use)
        # Of a film that has just these rows, sample s begins with path s x rows.
        add_pass(sums.radiance, sums.aovs, np.int64(sample * run.rows), chosen, rows.words, rows.halves)
        use.not_finite += int(sums.counters[1])
        use.clamped += int(sums.counters[2])
        for table in (sums.radiance, sums.aovs, sums.counters):
            table[:] = 0
    use.paths += run.samples * (int(np.count_nonzero(chosen)) if len(chosen) else run.rows)
    return rows


def film_of(tracer: Tracer, job: Job, use: Use, check: Callable[[], None]) -> Film:
    """The film of a whole image, level by level. `use` and `check` as of `rows_of`."""
    film, goes_on, before = Film(job.window.width, job.window.height, job.columns), EVERY_ROW, 0
    for level in levels_of(job.samples, job.adaptive):
        for run in runs_of(job.window.pixels, before, level, 1):
            part = slice_of(goes_on, run)
            if part is not None:
                film.add_rows(run.first_row, rows_of(tracer, job, run, part, use, check).words)
        before = level
        if job.adaptive is not None and level < job.samples:
            goes_on = going_on(film, job.adaptive.noise, goes_on)
            if not goes_on.any():
                break
    return film


def levels_of(samples: int, adaptive: Adaptive | None) -> tuple[int, ...]:
    """The numbers of samples after which is decided who goes on, and the last one."""
    return (samples,) if adaptive is None else adaptive.levels(samples)


def slice_of(goes_on: GoesOn, run: Run) -> bytes | None:
    """Which rows of a run go on, as `rows_of` wants it; None if none does."""
    if not len(goes_on):
        return b""
    part = goes_on[run.first_row : run.first_row + run.rows]
    return part.tobytes() if part.any() else None


def _trace(tracer: Tracer, first: int, chosen: GoesOn, sums: PassSums, use: Use) -> None:
    """One sample of each row that is chosen, all of them if none is named."""
    for rays in tracer.generate(first, len(sums.radiance)).values():
        wanted = rays[chosen[rays[:, 7] >> np.uint32(16)] != 0] if len(chosen) else rays
        use.rays += len(wanted)
        for at in range(0, len(wanted), PIECE_RAYS):
            outcome = tracer.advance(wanted[at : at + PIECE_RAYS], first, sums)
            assert not outcome.leaving, "a ray leaves who holds the whole scene"
            use.rays += outcome.created
            use.casts += outcome.casts
            use.shadow_casts += outcome.shadow_casts
