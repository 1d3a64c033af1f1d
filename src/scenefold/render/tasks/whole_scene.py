"""A whole scene, read from its store and opened for one job, in whatever thread a task is done."""

from __future__ import annotations

import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import trio

from scenefold.base.errors import DamagedData
from scenefold.render.arrays import JobNumbers
from scenefold.render.compiling import compile_apart
from scenefold.render.contract import OpenScene, Tracer, check_layers_written, load_renderer
from scenefold.render.developing import Box
from scenefold.render.first_cells import first_cells
from scenefold.render.in_memory import camera_of, job_of
from scenefold.render.job import Job, RenderOptions
from scenefold.render.numbers import depth_of_box, job_box
from scenefold.render.pool.share import LANE, load_share, read_tables
from scenefold.render.tasks.holding import RenderEnded
from scenefold.render.tasks.sources import Source
from scenefold.world import background_tasks, offline_world

RENDERER = "embree"
LOOK_S = 0.2
T = TypeVar("T")
_compiling = threading.Lock()
_compiled = threading.Event()
"""By this process, or for it."""


@dataclass(slots=True)
class WholeScene:
    """What is held for a job of one node; its tracers are lent to threads."""

    job: Job
    numbers: JobNumbers
    box: Box
    bytes_read: int
    """Of geometry and textures, decrypted."""
    not_carried: tuple[str, ...]
    scene: OpenScene
    _idle: list[Tracer] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def near(self) -> float:
        """How far the job's box is from the camera, as `develop` wants it."""
        return depth_of_box(self.job.camera, self.box)

    @contextmanager
    def tracer(self) -> Iterator[Tracer]:
        """One that no other thread has."""
        with self._lock:
            mine = self._idle.pop() if self._idle else self.scene.tracers(1)[0]
        try:
            yield mine
        finally:
            with self._lock:
                self._idle.append(mine)

    def close(self) -> None:
        """No thread has a tracer any more."""
        self._idle.clear()
        self.scene.close()


def open_whole(source: Source, options: RenderOptions, check: Callable[[], None], content: bytes | None = None) -> WholeScene:
    """Read and open a scene, in this thread; kernels that are not compiled yet are, by another process, before.

    `check`: raises RenderEnded once nobody wants the scene any more; then it is not waited for, but what only computes comes to its end.
    `content`: the digest that the scene's document must have; None: any. DamagedData if it is another one; the errors of the source;
    LocalFault if the scene has no such camera, or the renderer no such layer.
    """
    check()
    # Of the threads of a process one has them compiled, and the others find them there.
    with _compiling:
        check()
        if not _compiled.is_set():
            trio.run(_wanted, compile_apart, check)
            _compiled.set()
    return trio.run(_wanted, partial(_open, source, options, content), check)


async def _wanted(wait: Callable[[], Awaitable[T]], check: Callable[[], None]) -> T:
    """What that gives, unless `check` raises RenderEnded before."""
    made: list[T] = []

    async def look() -> None:
        while True:
            await trio.sleep(LOOK_S)
            check()

    try:
        async with background_tasks() as nursery:
            nursery.start_soon(look)
            made.append(await wait())
    except (RenderEnded, BaseExceptionGroup):
        # What computes cannot be cancelled. What it has made all the same is the caller's to close.
        if not made:
            check()
            raise
    return made[0]


async def _open(source: Source, options: RenderOptions, content: bytes | None) -> WholeScene:
    workers = offline_world(lanes={LANE: 1}).workers
    renderer = load_renderer(RENDERER)
    check_layers_written(renderer, options.layers)
    numeric_class = await workers.run(LANE, renderer.numeric_class)
    async with source.opened(workers) as (reader, not_carried):
        tables = await read_tables(reader, workers)
        if content is not None and tables.document.digest != content:
            raise DamagedData("the scene is not the one that the render began with", remedy="leave it alone, and render again")
        cells = first_cells(options.algorithm, 1, tables, camera_of(tables, options))
        job = job_of(tables, options, numeric_class, cells)
        loaded = await load_share(reader, workers, job, 0)
    scene = await workers.run(LANE, renderer.open, loaded.held, loaded.numbers, job.partition, 0)
    return WholeScene(job, loaded.numbers, job_box(tables), loaded.bytes_read, not_carried, scene)
