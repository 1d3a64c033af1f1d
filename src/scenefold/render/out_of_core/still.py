"""A scene file to an image within a memory budget, in this process: `scenectl render still FILE --memory`."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.base.rays import RAY_BYTES
from scenefold.render.arrays import SceneArrays
from scenefold.render.compiling import compile_apart
from scenefold.render.contract import BudgetedRenderer, load_renderer
from scenefold.render.developing import develop
from scenefold.render.in_memory import camera_of, job_of
from scenefold.render.job import Job, RenderOptions
from scenefold.render.layers import Pixels, image_bytes
from scenefold.render.numbers import depth_of_box, job_box, job_numbers
from scenefold.render.out_of_core.cells import Cells, cells_within
from scenefold.render.out_of_core.geometry_files import arrays_on_disk
from scenefold.render.out_of_core.importing import import_apart
from scenefold.render.out_of_core.pager import Pager, give_back
from scenefold.render.out_of_core.spill import Spill
from scenefold.render.out_of_core.sweep import Sweep
from scenefold.render.out_of_core.tracing import TREES_LANE, Counts, Tracing
from scenefold.render.pool.share import FILM_LANE, LANE, read_tables
from scenefold.scene.importers import Moment
from scenefold.scene.tables import SceneTables
from scenefold.world import offline_world
from scenefold.world.process_use import process_use

MIB = 1 << 20
THREAD_BYTES = 24 * MIB
"""What a thread works with, its tracer's buffers above all."""
PROGRAM_THREADS = 4
"""Of so many threads that is part of the 300 MiB of the program, which by itself is some 80."""
IMAGE_COPIES = 3
"""The layers, one of them in another order, and what is written."""

INSTANCE_BYTES = 640
"""Of each: its matrices, and what names it in the cells that it is in. Measured with 250,000."""
MATERIAL_BYTES = 2_048

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutOfCore:
    """What to render, and within what."""

    file: Path
    memory: int
    """Bytes: what the process may take beyond interpreter and compiled kernels."""
    threads: int = 1
    moment: Moment | None = None
    environment: Path | None = None
    folder: Path | None = None
    """Where files without a name are made; None: that for temporary files."""


@dataclass(frozen=True, slots=True)
class Made:
    """An image, and how it came about."""

    layers: dict[str, Pixels]
    """As of `StillResult`."""
    report: dict[str, Any]
    not_carried: tuple[str, ...]


async def render_within(asked: OutOfCore, options: RenderOptions, progress: Progress) -> Made:
    """Import the file, render it, and develop the image; kernels that are not compiled yet are, before all else.

    LocalFault if the file cannot be used, the budget is too small (with the smallest that is enough), or the disk is full.
    """
    options.check()
    workers = offline_world(lanes={LANE: asked.threads, TREES_LANE: 1}).workers
    with closing(Spill(asked.folder)) as spill:
        progress("prepare", 0, 1)
        await compile_apart()
        begun = time.monotonic()
        imported = await import_apart(asked.file, spill, asked.moment, asked.environment)
        import_seconds = time.monotonic() - begun
        tables = await read_tables(imported.records, workers)
        renderer = _renderer()
        cells, limit = await workers.run(LANE, _plan, tables, options, asked)
        memory = renderer.budget(limit)
        job = job_of(tables, options, renderer.numeric_class(), cells.partition)
        arrays = await arrays_on_disk(tables, imported.records, workers, spill)
        not_carried = imported.not_carried
        # Where each record lies nobody asks any more.
        del imported
        await workers.run(LANE, give_back)
        numbers = await workers.run(LANE, job_numbers, job, tables)
        progress("prepare", 1, 1)
        prepared, prepared_cpu = time.monotonic(), time.process_time()
        pager = Pager(renderer, tables, arrays, numbers, cells, memory)
        try:
            sweep = Sweep(cells.from_near_to_far(camera_of(tables, options).matrix[:3, 3]))
            tracing = Tracing(job, numbers.stride, pager, spill, workers, asked.threads, sweep)
            film = await tracing.run(lambda done, total: progress("render", done, total))
        finally:
            pager.close()
        traced, traced_cpu = time.monotonic(), time.process_time()
        box = job_box(tables)
        layers = await workers.run(FILM_LANE, develop, film, job.layers, box, depth_of_box(job.camera, box))
        seconds = {"import": import_seconds, "prepare": prepared - begun - import_seconds, "render": traced - prepared}
        report = _report(job, tracing.counts, seconds)
        report["processor_seconds"] = {"render": round(traced_cpu - prepared_cpu, 3)}
        report["memory"] = {
            "budget": asked.memory,
            "trees_limit": memory.limit,
            "trees_most": memory.most,
            "cells": len(cells.shares),
            "trees_built": pager.built,
            "trees_evicted": pager.evicted,
            "cells_worked_off": tracing.counts.visits,
            "rays_waiting_most": tracing.rays.most,
            "scene_bytes": scene_bytes(tables, arrays),
            "memory_most": process_use().memory_most,
        }
        return Made(layers, report, not_carried)


RENDERER = "embree"


def _renderer() -> BudgetedRenderer:
    renderer = load_renderer(RENDERER)
    if not isinstance(renderer, BudgetedRenderer):
        raise LocalFault(f"the renderer {RENDERER!r} has no bounds of memory", where="memory", remedy="leave out --memory")
    return renderer


def _plan(tables: SceneTables, options: RenderOptions, asked: OutOfCore) -> tuple[Cells, int]:
    """Cells whose trees can be built in what the budget leaves for trees, and these bytes; LocalFault if there are none."""
    beside = beside_trees(tables, options, asked.threads)
    camera_of(tables, options)
    limit = asked.memory - beside
    cells = cells_within(tables, max(limit, 0))
    if cells.largest > limit:
        least = -(-(cells.largest + beside) // MIB)
        raise LocalFault(
            f"a budget of {_amount(asked.memory)} is too small: of this scene and image, {beside / MIB:.0f} MiB must lie in memory beside trees, and {cells.largest / MIB:.0f} MiB for those of one part",
            where="memory",
            remedy=f"give at least {least} MiB",
        )
    return cells, limit


def _amount(count: int) -> str:
    return f"{count / MIB:.0f} MiB" if count >= MIB else f"{count:,} bytes"


def beside_trees(tables: SceneTables, options: RenderOptions, threads: int) -> int:
    """Bytes of the budget that trees cannot have: tables, the image, and what threads work with."""
    lights, environment = tables.lights, tables.environment.radiance if len(tables.environment) else np.zeros(0)
    small = [tables.groups.atoms, tables.groups.low, tables.groups.high, tables.instances.matrices, lights.corners, lights.emission]
    held = sum(array.nbytes for array in small) + environment.nbytes
    named = INSTANCE_BYTES * len(tables.instances) + MATERIAL_BYTES * len(tables.materials)
    return (
        2 * held
        + named
        + IMAGE_COPIES * image_bytes(options.layers, options.window.pixels)
        + max(threads - PROGRAM_THREADS, 0) * THREAD_BYTES
    )


def scene_bytes(tables: SceneTables, arrays: SceneArrays) -> int:
    """What the scene would take in memory: its arrays, and trees as they are built without a budget, some 70 bytes a triangle."""
    triangles = int(tables.groups.triangles.sum(dtype=np.int64))
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray)) + 70 * triangles


def _report(job: Job, counts: Counts, seconds: dict[str, float]) -> dict[str, Any]:
    """As of an image that nodes have made (docs/reference/scenectl.md), as far as it can be said of one process."""
    rendering = max(seconds["render"], 1e-9)
    return {
        "passes": job.plan.count,
        "paths": counts.paths,
        "samples_per_pixel": counts.paths / job.window.pixels,
        "numeric_class": job.numeric_class,
        "paths_before": 0,
        "paths_per_second": counts.paths / rendering,
        "rays": counts.rays,
        "rays_per_second": counts.rays / rendering,
        "cell_visits": counts.casts,
        "rays_passed": counts.passed,
        "rays_passed_per_path": counts.passed / max(counts.paths, 1),
        "packets_passed": 0,
        "bytes_passed": counts.passed * RAY_BYTES,
        "efficiency": 1.0,
        "contributions_not_finite": counts.not_finite,
        "contributions_clamped": counts.clamped,
        "render_seconds": {name: round(value, 3) for name, value in seconds.items()},
        "render_nodes": [],
    }
