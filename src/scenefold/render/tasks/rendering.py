"""A visual or temporal partition from the question to the images: cut, have it done, put together (specs/32-partitions.md)."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import trio

from scenefold.render.adaptive import going_on
from scenefold.render.compiling import compile_apart
from scenefold.render.developing import develop
from scenefold.render.film import EVERY_ROW, Film
from scenefold.render.film_rows import row_bytes
from scenefold.render.job import RenderOptions
from scenefold.render.layers import Pixels
from scenefold.render.pool.share import FILM_LANE, LANE
from scenefold.render.tasks.engine import ClusterEngine, Engine, ThreadsEngine, done_by
from scenefold.render.tasks.figures import Figures
from scenefold.render.tasks.handed_on import HandedOn
from scenefold.render.tasks.runs import runs_of
from scenefold.render.tasks.sources import Source
from scenefold.render.tasks.tracing import levels_of, slice_of
from scenefold.render.tasks.work import Asked, MadeFrame, TracedRun, end_render, render_frame, trace_run
from scenefold.world import offline_world

Progress = Callable[[str, int, int], None]
"""Of a phase, so many of so many; on the Trio thread."""

WAITING_BYTES_MAX = 1 << 30
"""Of frames that are made and not written yet."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Workers:
    """Who does the tasks."""

    threads: int = 1
    """Of this process,"""
    address: str | None = None
    """unless a Dask scheduler is named, as `checked_address` gave it."""
    is_secret: bool = False
    """Whether what they open must be out of others' reach: a scene of a cluster is."""


@dataclass(frozen=True, slots=True)
class Made:
    """An image, and how it came about."""

    layers: dict[str, Pixels]
    """As of `StillResult`."""
    report: dict[str, Any]
    not_carried: tuple[str, ...]


async def render_visual(source: Source, options: RenderOptions, workers: Workers, progress: Progress, content: bytes | None = None) -> Made:
    """One image, whose pixels are shared out; it has the bits that a pool's has.

    `content`: the digest of the scene's document; None: whatever it is. LocalFault, Refused, Unreachable or DamagedData say why there is none.
    """
    options.check()
    render, progress, threads = _named(), _on_trio(progress), offline_world().workers
    figures, film = Figures(), Film(options.window.width, options.window.height, options.columns)
    goes_on, before = EVERY_ROW, 0
    async with _engine(render, workers, progress) as (engine, seconds):
        begun = time.monotonic()
        for level in levels_of(options.samples, options.adaptive):
            runs = [(run, slice_of(goes_on, run)) for run in runs_of(options.window.pixels, before, level, engine.workers)]
            asked = Asked(render, source, options, content)
            tasks = [partial(trace_run, asked, run, part) for run, part in runs if part is not None]
            await done_by(engine, tasks, _Rows(film, figures, progress, len(tasks)), threads)
            before = level
            if options.adaptive is not None and level < options.samples:
                goes_on = await threads.run(LANE, going_on, film, options.adaptive.noise, goes_on)
                if not goes_on.any():
                    break
        seconds["render"] = time.monotonic() - begun
    seen = figures.seen
    assert seen is not None, "something was traced"
    begun = time.monotonic()
    layers = await threads.run(LANE, develop, film, options.layers, seen.box, seen.near)
    seconds["merge"] = time.monotonic() - begun
    report = {"partition": "visual", "engine": engine.name, **figures.document(options.window.pixels, seconds, engine.workers)}
    return Made(layers, report, seen.not_carried)


async def render_temporal(
    frames: Sequence[Source],
    options: RenderOptions,
    workers: Workers,
    progress: Progress,
    made: Callable[[int, dict[str, Pixels], tuple[str, ...]], None],
    content: bytes | None = None,
) -> dict[str, Any]:
    """Whole frames, each made by one thread; the report. `made`: gets each one's index, its layers and what its file could not carry, in any thread, one at a time.

    It is called while others are made, and what it takes beyond that is in no phase of the report. `content` and errors as of `render_visual`.
    Frames that were made before one of them failed have been given to `made`.
    """
    options.check()
    render, progress, threads = _named(), _on_trio(progress), offline_world().workers
    figures, done = Figures(), 0

    def write(index_and_frame: tuple[int, MadeFrame]) -> None:
        nonlocal done
        index, frame = index_and_frame
        made(index, frame.layers, frame.seen.not_carried)
        done += 1
        progress("render", done, len(frames))

    async with _engine(render, workers, progress) as (engine, seconds):
        handed_on = HandedOn(WAITING_BYTES_MAX, write)

        def take(index_and_frame: tuple[int, MadeFrame]) -> None:
            _, frame = index_and_frame
            size = sum(layer.nbytes for layer in frame.layers.values())
            figures.add(frame.seen, frame.use, size, is_same_scene=False)
            handed_on.give(index_and_frame, size)

        begun = time.monotonic()
        tasks = [partial(_numbered_frame, index, Asked(render, source, options, content)) for index, source in enumerate(frames)]
        async with trio.open_nursery() as nursery:
            nursery.start_soon(threads.run, FILM_LANE, handed_on.write_all)
            try:
                await done_by(engine, tasks, take, threads)
            finally:
                handed_on.end()
        assert handed_on.last_at is not None, "a frame was made"
        seconds["render"] = handed_on.last_at - begun
    document = figures.document(options.window.pixels * len(frames), seconds, engine.workers)
    return {"partition": "temporal", "engine": engine.name, **document}


def _numbered_frame(index: int, asked: Asked) -> tuple[int, MadeFrame]:
    return index, render_frame(asked)


def _named() -> str:
    """A name that no other render has, on whatever computer its tasks are done."""
    return offline_world().entropy.token(16).hex()


def _on_trio(progress: Progress) -> Progress:
    """The same from any thread, which does not wait for it."""
    token = trio.lowlevel.current_trio_token()
    return lambda phase, done, total: token.run_sync_soon(progress, phase, done, total)


class _Rows:
    """Takes what tasks have traced into a film."""

    def __init__(self, film: Film, figures: Figures, progress: Progress, tasks: int) -> None:
        self._film, self._figures, self._progress, self._tasks, self._done = film, figures, progress, tasks, 0

    def __call__(self, traced: TracedRun) -> None:
        columns = self._film.rows.columns
        # A copy: for rows that cannot be written kernels would be compiled once more.
        words = np.frombuffer(traced.rows, np.uint64).reshape(traced.run.rows, row_bytes(columns) // 8).copy()
        self._figures.add(traced.seen, traced.use, len(traced.rows))
        self._film.add_rows(traced.run.first_row, words)
        self._done += 1
        self._progress("render", self._done, self._tasks)


@asynccontextmanager
async def _engine(render: str, workers: Workers, progress: Progress) -> AsyncIterator[tuple[Engine, dict[str, float]]]:
    """Of one render, and seconds that its phases have taken; what tasks hold is let go of at the end."""
    progress("prepare", 0, 1)
    begun, threads = time.monotonic(), offline_world().workers
    end = partial(end_render, render)
    made: Engine
    if workers.address is None:
        # Else each thread would wait for the first one, which would do it in its task.
        await compile_apart()
        made = await threads.run(LANE, ThreadsEngine, workers.threads, end)
    else:
        made = await threads.run(LANE, partial(ClusterEngine, workers.address, end, is_secret=workers.is_secret))
    try:
        progress("prepare", 1, 1)
        yield made, {"prepare": time.monotonic() - begun}
    finally:
        with trio.CancelScope(shield=True):
            await threads.run(LANE, made.close)
