"""The images of `embree` beside those of Mitsuba 3, from the same scene and with the same models.

    python benchmarks/compare_with_mitsuba.py cornell bmw27.glb --sky 0.37,0.44,0.5 --size 192x108 --output compared

A scene file is imported into memory. `embree` renders it through the contract; Mitsuba renders its triangles, materials and lights with
its own sensor, box filter, sampler and `volpath` integrator, and with glTF's surface as a BSDF written from glTF 2.0, appendix B
(renderers/mitsuba/gltf_bsdf.py). No line is common between record and film. Both are taken in batches of different seeds, whose spread says how sure they are.
It prints a table (or JSON) and writes ours, theirs and the difference as PNG. Ends with 77 and a reason where Mitsuba is missing.

Between both images one thing differs by design: a tint that is not grey costs ours a segment of the path, and theirs none.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from image_judge import Estimate, difference_image, judge, of_batches
from one_scene import SKIPPED, asked_of, imported, mitsuba_or_none, name_of, scene_arguments, traced
from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.render.arrays import F32
from scenefold.render.contract import load_renderer
from scenefold.render.in_memory import OneNodeJob
from scenefold.render.lens import Lens
from scenefold.render.numbers import job_numbers
from scenefold.render.renderers.mitsuba.library import Mitsuba
from scenefold.render.renderers.mitsuba.scenes import scene_of
from scenefold.render.renderers.mitsuba.views import integrator_of, sensor_of
from scenefold.render.view import automatic_exposure, shown


def main() -> int:
    options = _options()
    use_kernel_cache()
    mitsuba = mitsuba_or_none()
    if mitsuba is None:
        return SKIPPED
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    reports = []
    for scene in options.scenes:
        report = _compare(mitsuba, scene, options, folder)
        reports.append(report)
        print(json.dumps(report) if options.json else _line(report), flush=True)
    return 0


def _options() -> argparse.Namespace:
    parser = scene_arguments(__doc__, "128x72", 512)
    parser.add_argument("--batches", type=int, default=32, help="into which the samples are cut")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lens", default=None, help="radius of a thin lens and distance of its focus, two numbers of the scene's unit")
    parser.add_argument("--output", default="compared", help="folder of the images")
    return parser.parse_args()


def _compare(mitsuba: Mitsuba, scene: str, options: argparse.Namespace, folder: Path) -> dict[str, Any]:
    asked = replace(asked_of(options, seed=options.seed), lens=_lens(options.lens))
    one = imported(scene, asked)
    begun = time.perf_counter()
    ours = _ours(one, options.batches)
    between = time.perf_counter()
    theirs = _theirs(mitsuba, one, options.batches)
    ended = time.perf_counter()
    name = name_of(scene)
    if options.camera:
        name += f"-{options.camera}"
    stops = automatic_exposure(theirs.mean.astype(np.float32))
    for kind, estimate in (("ours", ours), ("theirs", theirs)):
        Image.fromarray(shown(estimate.mean.astype(np.float32), "srgb", stops).pixels).save(folder / f"{name}-{kind}.png")
    Image.fromarray(difference_image(ours, theirs)).save(folder / f"{name}-difference.png")
    seconds = {"seconds_ours": between - begun, "seconds_theirs": ended - between}
    return {
        "scene": name,
        "variant": mitsuba.variant,
        "size": [asked.width, asked.height],
        "samples": options.samples,
        **judge(ours, theirs),
        **seconds,
    }


def _lens(said: str | None) -> Lens | None:
    if said is None:
        return None
    aperture, focus = (float(length) for length in said.split(","))
    return Lens(aperture, focus)


def _ours(one: OneNodeJob, batches: int) -> Estimate:
    """Batches differ in their seeds, for samples of one seed may depend on one another."""
    each = max(1, one.loaded.numbers.samples // batches)
    return of_batches(np.array([_image(one, one.job.seed + number, each) for number in range(batches)], np.float64))


def _image(one: OneNodeJob, seed: int, samples: int) -> F32:
    job = replace(one.job, seed=seed, samples=samples)
    numbers = job_numbers(job, one.loaded.tables)
    opened = load_renderer("embree").open(one.loaded.held, numbers, job.partition, 0)
    beauty, _ = traced(replace(one, job=job), numbers, opened)
    opened.close()
    return beauty


def _theirs(mitsuba: Mitsuba, one: OneNodeJob, batches: int) -> Estimate:
    numbers = one.loaded.numbers
    scene = scene_of(mitsuba, one.loaded.held, numbers)
    sensor, integrator = sensor_of(mitsuba, numbers), integrator_of(mitsuba, numbers)
    each = max(1, numbers.samples // batches)
    seeds = range(one.job.seed, one.job.seed + batches)
    images = [np.array(mitsuba.mi.render(scene, sensor=sensor, integrator=integrator, spp=each, seed=seed)) for seed in seeds]
    return of_batches(np.array(images, np.float64)[..., :3])


def _line(report: dict[str, Any]) -> str:
    worst = report["worst_block"]
    channels = ", ".join(f"{one['difference_percent']:+.3f} ({one['standard_error_percent']:.3f})" for one in report["channels"])
    return (
        f"{report['scene']:28} mean {report['mean']:.4g}  difference {report['luminance_difference_percent']:+.3f} % "
        f"(error {report['standard_error_percent']:.3f} %)  red, green, blue {channels}  "
        f"rejected {report['rejected_percent']:.1f} % of {report['noisy_pixels']} pixels, "
        f"{report['rejected_percent_blocks']:.1f} % of blocks; beyond 3.29: {report['far_off_percent']:.2f} %; "
        f"quiet that differ {report['quiet_pixels_that_differ']}; worst block z {worst['z']:+.1f} at {worst['x']},{worst['y']}; "
        f"{report['seconds_ours']:.0f} s and {report['seconds_theirs']:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
