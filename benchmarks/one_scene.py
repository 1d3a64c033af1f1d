"""What the comparisons with other renderers share: one scene for all of them, how it is asked for, and its image by `embree`."""

from __future__ import annotations

import argparse
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import trio

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import F32, JobNumbers
from scenefold.render.contract import OpenScene, load_renderer
from scenefold.render.developing import develop
from scenefold.render.film import Film
from scenefold.render.in_memory import OneNodeJob, one_node_job
from scenefold.render.job import RenderOptions
from scenefold.render.layers import USUAL
from scenefold.render.numbers import job_box
from scenefold.render.pass_sums import PassSums
from scenefold.render.renderers.mitsuba.library import Mitsuba, load
from scenefold.scene.cornell import cornell_box
from scenefold.world import offline_world

SKIPPED = 77
"""What a comparison ends with where the other renderer is missing."""
CORNELL = "cornell"


def mitsuba_or_none() -> Mitsuba | None:
    """None where it is missing, which is said."""
    try:
        return load()
    except LocalFault as fault:
        print(f"skipped: {fault}", file=sys.stderr)
        return None


def scene_arguments(about: str | None, size: str, samples: int) -> argparse.ArgumentParser:
    """A parser of scenes and of what an image of them is; the usual `size` and `samples`."""
    parser = argparse.ArgumentParser(description=(about or "").partition("\n")[0])
    parser.add_argument("scenes", nargs="+", help=f"scene files, or {CORNELL}")
    parser.add_argument("--size", default=size, help="pixels, width x height")
    parser.add_argument("--samples", type=int, default=samples, help="of each image, per pixel")
    parser.add_argument("--depth", type=int, default=8)
    parser.add_argument("--sky", default="0,0,0", help="radiance, three numbers")
    parser.add_argument("--camera", default=None)
    parser.add_argument("--json", action="store_true")
    return parser


def asked_of(options: argparse.Namespace, *, seed: int = 1, layers: tuple[str, ...] = USUAL) -> RenderOptions:
    """What these arguments ask for, with textures read from their finest level alone, as other renderers do."""
    width, height = (int(side) for side in options.size.split("x"))
    red, green, blue = (float(channel) for channel in options.sky.split(","))
    return RenderOptions(
        width=width, height=height, samples=options.samples, seed=seed, depth=options.depth, sky=(red, green, blue), camera=options.camera,
        layers=layers, mips=False,
    )  # fmt: skip


def name_of(scene: str) -> str:
    """What a report calls it."""
    return scene if scene == CORNELL else Path(scene).stem


def imported(scene: str, asked: RenderOptions) -> OneNodeJob:
    """The scene in memory, and a job of one node over it; LocalFault if the file cannot be used."""
    numeric_class = load_renderer("embree").numeric_class()
    with tempfile.TemporaryDirectory(prefix="one-scene-") as place:
        file = Path(scene)
        if scene == CORNELL:
            file = Path(place) / "cornell.glb"
            file.write_bytes(cornell_box())
        return trio.run(partial(one_node_job, file, asked, numeric_class, offline_world().workers))


def traced(one: OneNodeJob, numbers: JobNumbers, opened: OpenScene, threads: int = 1) -> tuple[F32, int]:
    """The beauty, and how many rays were cast for it; with as many threads as a node would take."""
    plan, film = one.job.plan, Film(numbers.width, numbers.height)
    lock, free, casts = threading.Lock(), list(opened.tracers(threads)), 0

    def trace(number: int) -> None:
        nonlocal casts
        with lock:
            tracer = free.pop()
        first, count = plan.first_path(number), plan.size(number)
        sums = PassSums.zeros(count)
        done = [tracer.advance(batch, first, sums) for batch in tracer.generate(first, count).values()]
        with lock:
            free.append(tracer)
            film.add(sums, first, numbers.stride)
            casts += sum(batch.casts for batch in done)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(trace, range(plan.count)))
    beauty: F32 = develop(film, (), job_box(one.loaded.tables))["beauty"]
    return beauty, casts
