"""How fast `embree` makes an image, and how fast an image of equal error, beside Mitsuba 3 and Cycles.

    python benchmarks/beside_renderers.py cornell bmw27.glb --diffuse --size 512x512 --samples 64 --cycles BPYENV/bin/python

All renderers are given the same triangles, lights, camera, depth and start of roulette, and take turns: one image each, of a seed of its
own, again and again. What comes once (reading the scene, building its hierarchy, compiling kernels) is not counted.
The error of an image is told from how images of different seeds scatter around their mean: every renderer is its own reference, so it
counts noise and not what models differ in. Pixels weigh by their own brightness, and the noisiest thousandth is left out. Whether they
show the same is told by their means, and by how sure these are of few images.

`--diffuse` has every surface reflect its base colour evenly, in all renderers: what is compared then is tracing and not shading.
Without it, Cycles is left out, since its surfaces are others; with points, spots or suns, too, which it is not given. Ends with 77 and a reason where Mitsuba is missing.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from cycles_process import Cycles
from image_judge import judge, of_batches
from mitsuba_rays import rays_per_path
from one_scene import SKIPPED, asked_of, imported, mitsuba_or_none, name_of, scene_arguments, traced
from plain_surfaces import all_diffuse, mitsuba_scene
from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.render.contract import OpenScene, load_renderer
from scenefold.render.in_memory import OneNodeJob
from scenefold.render.numbers import job_numbers
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.scenes import scene_of
from scenefold.render.renderers.mitsuba.views import sensor_of

F64 = npt.NDArray[np.float64]
ROULETTE_FROM = 3
NOISIEST = 1e-3
"""Share of pixels that is left out of an error: a firefly more or less would decide it."""
_WEIGHTS = np.array([0.2126, 0.7152, 0.0722])


class Renders(Protocol):
    """One renderer with one scene."""

    name: str

    def ready(self, seed: int) -> None:
        """Do what comes once a scene, and is not counted."""

    def image(self, seed: int) -> F64:
        """float64[H, W, 3]"""

    def rays(self) -> float | None:
        """Segments and shadow rays a path; None if it does not say."""


class Ours:
    """`embree`, through the renderer's contract, with as many threads as a node would take."""

    name = "embree"

    def __init__(self, one: OneNodeJob, threads: int) -> None:
        self._one, self._threads = one, threads
        self._numbers = job_numbers(one.job, one.loaded.tables)
        self._count = 0.0
        self._opened: OpenScene | None = None

    def ready(self, seed: int) -> None:
        # A job's numbers hold its seed, so the trees are built again for each.
        numbers = job_numbers(replace(self._one.job, seed=seed), self._one.loaded.tables)
        self._opened = load_renderer("embree").open(self._one.loaded.held, numbers, self._one.job.partition, 0)

    def image(self, seed: int) -> F64:
        numbers, opened = self._numbers, self._opened
        assert opened is not None
        image, casts = traced(self._one, numbers, opened, self._threads)
        opened.close()
        self._count = casts / (numbers.width * numbers.height * numbers.samples)
        return np.asarray(image, np.float64)

    def rays(self) -> float | None:
        return self._count


class Theirs:
    """Mitsuba: its own sensor, sampler and integrator."""

    name = "mitsuba"

    def ready(self, seed: int) -> None:
        """It was built with the scene."""

    def __init__(self, mitsuba: Mitsuba, one: OneNodeJob, threads: int, *, is_diffuse: bool) -> None:
        self._mitsuba, self._samples, self._depth = mitsuba, one.job.samples, one.job.depth
        mitsuba.dr.set_thread_count(threads)
        build = mitsuba_scene if is_diffuse else scene_of
        self._scene = build(mitsuba, one.loaded.held, one.loaded.numbers)
        self._sensor = sensor_of(mitsuba, one.loaded.numbers)
        kind = "path" if is_diffuse else "volpath"
        self._integrator = mitsuba.mi.load_dict({"type": kind, "max_depth": self._depth, "rr_depth": ROULETTE_FROM})

    def image(self, seed: int) -> F64:
        image = self._mitsuba.mi.render(self._scene, sensor=self._sensor, integrator=self._integrator, spp=self._samples, seed=seed)
        return np.array(image, np.float64)[..., :3]

    def rays(self) -> float | None:
        return rays_per_path(self._mitsuba, self._scene, self._sensor, self._depth, ROULETTE_FROM)


def main() -> int:
    options = _options()
    use_kernel_cache()
    mitsuba = mitsuba_or_none()
    if mitsuba is None:
        return SKIPPED
    for scene in options.scenes:
        with ExitStack() as stack:
            report = _compare(mitsuba, scene, options, stack)
        print(json.dumps(report) if options.json else _lines(report), flush=True)
    return 0


def _options() -> argparse.Namespace:
    parser = scene_arguments(__doc__, "256x256", 64)
    parser.add_argument("--images", type=int, default=6, help="of each renderer, after one that does not count; at least 2")
    parser.add_argument("--threads", type=int, default=1, help="of each renderer")
    parser.add_argument("--diffuse", action="store_true", help="every surface reflects its base colour evenly")
    parser.add_argument("--cycles", default=None, help="a Python that has the package bpy")
    return parser.parse_args()


def _compare(mitsuba: Mitsuba, scene: str, options: argparse.Namespace, stack: ExitStack) -> dict[str, Any]:
    asked = asked_of(options, layers=())
    width, height = asked.width, asked.height
    one = imported(scene, asked)
    if options.diffuse:
        one = replace(one, loaded=replace(one.loaded, held=all_diffuse(one.loaded.held)))
    renderers: list[Renders] = [Ours(one, options.threads), Theirs(mitsuba, one, options.threads, is_diffuse=options.diffuse)]
    if options.cycles and options.diffuse and not len(one.loaded.held.arrays.punctual_lights):
        renderers.append(stack.enter_context(Cycles(options.cycles, one, options.threads, ROULETTE_FROM)))
    seconds: dict[str, list[float]] = {renderer.name: [] for renderer in renderers}
    images: dict[str, list[F64]] = {renderer.name: [] for renderer in renderers}
    for number in range(options.images + 1):
        for renderer in renderers:
            renderer.ready(1 + number)
            begun = time.perf_counter()
            image = renderer.image(1 + number)
            took_s = time.perf_counter() - begun
            if number:
                seconds[renderer.name].append(took_s)
                images[renderer.name].append(image)
    paths = width * height * options.samples
    found = {
        renderer.name: _measured(paths, seconds[renderer.name], np.array(images[renderer.name]), renderer.rays()) for renderer in renderers
    }
    ours = found["embree"]
    means = {name: judge(of_batches(np.array(images["embree"])), of_batches(np.array(images[name]))) for name in found}
    return {
        "scene": name_of(scene),
        "triangles": one.loaded.share.instanced_triangles,
        "size": [width, height],
        "samples": options.samples,
        "depth": options.depth,
        "threads": options.threads,
        "diffuse": options.diffuse,
        "renderers": found,
        "ours_of_theirs": {
            name: {
                "paths_per_s": ours["paths_per_s"] / other["paths_per_s"],
                "speed_to_equal_error": other["error_seconds"] / ours["error_seconds"],
                "mean_difference_percent": means[name]["luminance_difference_percent"],
                "standard_error_percent": means[name]["standard_error_percent"],
            }
            for name, other in found.items()
            if name != "embree"
        },
    }


def _measured(paths: int, seconds: list[float], images: F64, rays: float | None) -> dict[str, Any]:
    middle = float(np.median(seconds))
    error = _error(images)
    return {
        "seconds": [min(seconds), middle, max(seconds)],
        "paths_per_s": paths / middle,
        "rays_per_path": rays,
        "mean": float((images @ _WEIGHTS).mean()),
        "error": error,
        "error_seconds": error * middle,
    }


def _error(images: F64) -> float:
    """The variance of one image, relative to its brightness, of all pixels but the noisiest."""
    light = images @ _WEIGHTS
    mean, variance = light.mean(axis=0), light.var(axis=0, ddof=1)
    relative = np.sort((variance / (mean**2 + (0.01 * light.mean()) ** 2)).ravel())
    return float(relative[: max(1, round(len(relative) * (1 - NOISIEST)))].mean())


def _lines(report: dict[str, Any]) -> str:
    lines = [
        f"{report['scene']}: {report['triangles']:,} triangles, {report['size'][0]} x {report['size'][1]}, {report['samples']} samples, "
        f"depth {report['depth']}, {report['threads']} thread(s){', all diffuse' if report['diffuse'] else ''}"
    ]
    for name, found in report["renderers"].items():
        least, middle, most = found["seconds"]
        rays = "" if found["rays_per_path"] is None else f", {found['rays_per_path']:.2f} rays a path"
        lines.append(
            f"  {name:8} {found['paths_per_s'] / 1e6:6.3f} M paths/s ({middle:.2f} s, {least:.2f} to {most:.2f}){rays}, "
            f"mean {found['mean']:.4g}, error {found['error']:.3e}"
        )
    for name, ratio in report["ours_of_theirs"].items():
        lines.append(
            f"  beside {name}: {ratio['paths_per_s']:.2f} times the paths, {ratio['speed_to_equal_error']:.2f} times as fast to equal error, "
            f"mean {ratio['mean_difference_percent']:+.3f} % (error {ratio['standard_error_percent']:.3f} %)"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
