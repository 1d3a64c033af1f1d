"""The `mitsuba` renderer: one node that holds the whole scene, camera rays as records, Mitsuba's integrator for all the rest.

It passes the test kit at the statistical level: an image is right, and equal in its bits only where batches are equal.
Dice are seeded by the job's seed and the batch itself, so that a pass that is traced again in the same batches is the same.
"""

from __future__ import annotations

import threading
import zlib
from typing import Any

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition
from scenefold.render.arrays import F64, U32, JobNumbers
from scenefold.render.contract import Advanced, HeldScene, Tracer
from scenefold.render.pass_sums import PassSums
from scenefold.render.record_columns import PathRays, camera_rays, path_rays
from scenefold.render.renderers.mitsuba.features import note_first_hits
from scenefold.render.renderers.mitsuba.library import Mitsuba, load
from scenefold.render.renderers.mitsuba.scenes import scene_of
from scenefold.render.renderers.mitsuba.views import integrator_of

_UNIT = 2.0**32
_RADIANCE_MAX = 2.0**24
_NOT_FINITE, _CLAMPED = 1, 2
_running = threading.Lock()
"""Mitsuba spreads one call over all cores, and keeps its state in the process: calls follow each other."""


class MitsubaTracer:
    """Traces wavefronts. Any number of them share the scene, and the lock."""

    def __init__(self, mitsuba: Mitsuba, scene: Any, integrator: Any, numbers: JobNumbers) -> None:
        self._mitsuba, self._scene, self._numbers = mitsuba, scene, numbers
        self._integrator = integrator

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        """See `Tracer`."""
        return {0: camera_rays(self._numbers, first_path, count)}

    def advance(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        """See `Tracer`. Every ray ends here; what light a ray of a later bounce finds, is weighed as a camera ray's."""
        chosen = path_rays(rays, len(sums.radiance))
        if len(chosen.rows):
            with _running:
                radiance = self._radiance(rays, chosen)
                note_first_hits(self._mitsuba, self._scene, self._numbers, chosen, sums.aovs)
            _add(radiance * chosen.throughputs, chosen, sums)
        return Advanced({}, 0, len(rays), len(rays), 0)

    def _radiance(self, rays: U32, chosen: PathRays) -> F64:
        """Incident radiance along each ray, float64[n, 3]."""
        mi = self._mitsuba.mi
        seed = zlib.crc32(rays.tobytes(), self._numbers.seed & 0xFFFFFFFF)
        sampler = mi.load_dict({"type": "independent"})
        if not self._mitsuba.is_wavefront:
            return self._one_by_one(sampler, seed, chosen)
        sampler.seed(seed, len(chosen.rows))
        ray = mi.RayDifferential3f(mi.Point3f(chosen.origins.T), mi.Vector3f(chosen.directions.T))
        light, _, _ = self._integrator.sample(self._scene, sampler, ray)
        return np.array(light, np.float64).reshape(3, -1).T

    def _one_by_one(self, sampler: Any, seed: int, chosen: PathRays) -> F64:
        mi = self._mitsuba.mi
        sampler.seed(seed)
        radiance = np.empty((len(chosen.rows), 3))
        for row, origin, direction in zip(radiance, chosen.origins, chosen.directions, strict=True):
            light, _, _ = self._integrator.sample(self._scene, sampler, mi.RayDifferential3f(origin.tolist(), direction.tolist()))
            row[:] = np.array(light, np.float64)
        return radiance


def _add(radiance: F64, chosen: PathRays, sums: PassSums) -> None:
    """Into the paths' sums, in whole units of 2^-32 (specs/08-passes.md)."""
    finite = np.isfinite(radiance).all(axis=1) & (radiance >= 0.0).all(axis=1)
    clamped = finite & (radiance >= _RADIANCE_MAX).any(axis=1)
    sums.counters[_NOT_FINITE] += int((~finite).sum())
    sums.counters[_CLAMPED] += int(clamped.sum())
    units = np.floor(np.minimum(radiance[finite], _RADIANCE_MAX) * _UNIT + 0.5).astype(np.int64)
    np.add.at(sums.radiance, chosen.paths[finite], units)


class MitsubaScene:
    """A scene in Mitsuba's memory."""

    def __init__(self, mitsuba: Mitsuba, held: HeldScene, numbers: JobNumbers) -> None:
        self._mitsuba, self._numbers = mitsuba, numbers
        with _running:
            self._integrator = integrator_of(mitsuba, numbers)
            self._scene = scene_of(mitsuba, held, numbers)

    def tracers(self, count: int) -> list[Tracer]:
        """See `OpenScene`."""
        return [MitsubaTracer(self._mitsuba, self._scene, self._integrator, self._numbers) for _ in range(count)]

    def close(self) -> None:
        """See `OpenScene`."""
        self._scene = None


class MitsubaRenderer:
    """The whole scene on one node, in Mitsuba 3."""

    def numeric_class(self) -> str:
        """See `Renderer`. LocalFault where Mitsuba is not installed."""
        mitsuba = load()
        return f"mitsuba {mitsuba.mi.__version__} {mitsuba.variant}"

    def open(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> MitsubaScene:
        """See `Renderer`."""
        if partition.nodes != 1:
            raise LocalFault(
                f"mitsuba renders on one node, and this job has {partition.nodes}", remedy="give it one node, or render with embree"
            )
        return MitsubaScene(load(), held, numbers)
