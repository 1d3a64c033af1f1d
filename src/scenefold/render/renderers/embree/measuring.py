"""How fast this renderer is, where its time goes, and how much of embreex's own rate it keeps: `EmbreeRenderer.measure`.

Three things alternate, again and again, so that whatever else the machine does meets all of them alike:

    bare    embreex alone on the rays that the render casts (bare.py)
    cast    our caster alone on the same rays, in the same batches
    whole   the render itself: generate, cast, shade, route, film

All in one thread, and in seconds of that thread's processor time: then a busy machine disturbs least. Wall
clock stands beside it; where the two differ, the figures are worth little.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from scenefold.partition import Partition
from scenefold.render.arrays import U8, U32, JobNumbers
from scenefold.render.contract import HeldScene
from scenefold.render.film import Film
from scenefold.render.pass_sums import PassSums
from scenefold.render.passes import PassPlan
from scenefold.render.renderers.embree.bare import bare_batch, bare_scene, cast_bare
from scenefold.render.renderers.embree.geometry import HeldGeometry
from scenefold.render.renderers.embree.tracer import EmbreeTracer

STAGES = ("generate", "cast", "shade", "route", "film")


class StagedTracer(EmbreeTracer):
    """A tracer that knows how long its stages took, and can keep copies of what it casts."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.kept: list[tuple[int, U32]] | None = None
        """(first path of the pass, batch), of all batches while it is a list."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        begun = time.thread_time()
        yield
        self.seconds[name] += time.thread_time() - begun

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        with self.stage("generate"):
            return super().generate(first_path, count)

    def cast_again(self, batch: U32, first_path: int) -> None:
        """The caster alone."""
        super()._cast(batch, first_path, self._status[: len(batch)])

    def _cast(self, batch: U32, first_path: int, status: U8) -> None:
        if self.kept is not None:
            self.kept.append((first_path, batch.copy()))
        with self.stage("cast"):
            super()._cast(batch, first_path, status)

    def _shade(self, batch: U32, first_path: int, status: U8, sums: PassSums) -> int:
        with self.stage("shade"):
            return super()._shade(batch, first_path, status, sums)


class Measurement:
    """One scene and job, ready to be measured."""

    def __init__(self, held: HeldScene, numbers: JobNumbers, partition: Partition, rays_max: int) -> None:
        self._numbers = numbers
        self._plan = PassPlan(1, numbers.width * numbers.height * numbers.samples)
        self._geometry = HeldGeometry(held)
        self._tracer = StagedTracer(held.arrays, self._geometry, numbers, partition, 0)
        self._bare = bare_scene(held)
        self._batches = self._capture(rays_max)
        self._bare_batches = [bare_batch(rays) for _, rays in self._batches]
        self.rays = sum(len(batch.path_origins) + len(batch.shadow_origins) for batch in self._bare_batches)
        self.shadow_rays = sum(len(batch.shadow_origins) for batch in self._bare_batches)

    def close(self) -> None:
        """Free the trees."""
        self._geometry.close()

    def _capture(self, rays_max: int) -> list[tuple[int, U32]]:
        """What the first passes cast, without rays that miss the box: no caster is asked about these."""
        self._tracer.kept = []
        for number in range(self._plan.count):
            self._trace(number, Film(self._numbers.width, self._numbers.height))
            if sum(len(rays) for _, rays in self._tracer.kept) >= rays_max:
                break
        kept, self._tracer.kept = self._tracer.kept, None
        return [(first, rays[(rays[:, 8] >> np.uint32(16)) < 65535]) for first, rays in kept]

    def _trace(self, number: int, film: Film) -> int:
        """One pass; returns how many rays it cast."""
        first, count = self._plan.first_path(number), self._plan.size(number)
        sums = PassSums.zeros(count)
        casts = 0
        for rays in self._tracer.generate(first, count).values():
            casts += self._tracer.advance(rays, first, sums).casts
        with self._tracer.stage("film"):
            film.add(sums, first, self._numbers.stride)
        return casts

    def bare(self) -> None:
        """embreex on the captured rays."""
        cast_bare(self._bare, self._bare_batches)

    def copies(self) -> list[tuple[int, U32]]:
        """The captured rays anew: casting advances t_done in them."""
        return [(first, rays.copy()) for first, rays in self._batches]

    def cast(self, copies: list[tuple[int, U32]]) -> None:
        """Our caster on the captured rays."""
        for first, rays in copies:
            self._tracer.cast_again(rays, first)

    def whole(self) -> tuple[int, dict[str, float]]:
        """The whole render: rays cast, and seconds by stage; what is in no other stage is "route"."""
        self._tracer.seconds = dict.fromkeys(STAGES, 0.0)
        begun = time.thread_time()
        film = Film(self._numbers.width, self._numbers.height)
        casts = sum(self._trace(number, film) for number in range(self._plan.count))
        seconds = self._tracer.seconds
        seconds["route"] = max(0.0, time.thread_time() - begun - sum(seconds.values()))
        return casts, seconds


def measure(held: HeldScene, numbers: JobNumbers, partition: Partition, repetitions: int, rays_max: int) -> dict[str, Any]:
    """The report of `scenectl bench render`, one thread (docs/reference/scenectl.md). Takes a while: call it in a worker."""
    measurement = Measurement(held, numbers, partition, rays_max)
    try:
        return _measured(measurement, numbers, repetitions)
    finally:
        measurement.close()


def _measured(measurement: Measurement, numbers: JobNumbers, repetitions: int) -> dict[str, Any]:
    measurement.bare()
    measurement.cast(measurement.copies())
    bare_s, cast_s, whole_s = [], [], []
    stages: list[dict[str, float]] = []
    casts = 0
    begun, begun_cpu = time.perf_counter(), time.thread_time()
    for _ in range(repetitions):
        copies = measurement.copies()
        bare_s.append(_seconds(measurement.bare))
        cast_s.append(_seconds(measurement.cast, copies))
        before = time.thread_time()
        casts, by_stage = measurement.whole()
        whole_s.append(time.thread_time() - before)
        stages.append(by_stage)
    busy = (time.thread_time() - begun_cpu) / max(time.perf_counter() - begun, 1e-9)
    paths = numbers.width * numbers.height * numbers.samples
    bare, cast, whole = (_rates(measurement.rays, bare_s), _rates(measurement.rays, cast_s), _rates(casts, whole_s))
    return {
        "paths": paths,
        "rays": casts,
        "rays_per_path": casts / paths,
        "captured_rays": measurement.rays,
        "captured_shadow_share": measurement.shadow_rays / max(measurement.rays, 1),
        "repetitions": repetitions,
        "processor_share": busy,
        "paths_per_s": _spread(_rates(paths, whole_s)),
        "rays_per_s": _spread(whole),
        "caster_rays_per_s": _spread(cast),
        "embree_rays_per_s": _spread(bare),
        "caster_kept": _spread(cast / bare),
        "kept": _spread(whole / bare),
        "stage_share": {name: statistics.median(part[name] / sum(part.values()) for part in stages) for name in STAGES},
        "stage_ns_per_ray": {name: statistics.median(part[name] for part in stages) / casts * 1e9 for name in STAGES},
    }


def _seconds(call: Callable[..., None], *args: Any) -> float:
    begun = time.thread_time()
    call(*args)
    return time.thread_time() - begun


def _rates(count: int, seconds: list[float]) -> npt.NDArray[np.float64]:
    rates: npt.NDArray[np.float64] = count / np.maximum(np.array(seconds), 1e-9)
    return rates


def _spread(values: npt.NDArray[np.float64]) -> dict[str, float]:
    return {"median": float(np.median(values)), "min": float(values.min()), "max": float(values.max())}
