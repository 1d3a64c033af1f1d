"""The kit's rig with `embree` in it, and single rays."""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import NOTHING_KNOWN, U32
from scenefold.render.generate_kernels import SCRATCH_WORDS
from scenefold.render.job import Job
from scenefold.render.kit.rig import Flight, Rendered
from scenefold.render.kit.rig import Rig as KitRig
from scenefold.render.numbers import job_numbers
from scenefold.render.pass_sums import PassSums
from scenefold.render.renderers.embree.cast_kernels import find_owners
from scenefold.render.renderers.embree.renderer import EmbreeRenderer
from scenefold.scene.importers.source import SourceScene

__all__ = ["Flight", "Rendered", "Rig"]


class Rig(KitRig):
    """A scene that `embree` renders on any number of nodes."""

    def __init__(self, source: SourceScene, group_triangles: int = 40) -> None:
        super().__init__(source, EmbreeRenderer(), group_triangles)

    def fly(self, job: Job, rays: U32) -> PassSums:
        """Only these rays, each of a path of its own, from where they are."""
        numbers, owners = job_numbers(job, self.tables), np.empty(len(rays), np.int32)
        partition, zero = job.partition, np.int32(0)
        scratch = np.empty(SCRATCH_WORDS, np.uint32)
        cells = np.int32(partition.family), partition.kernel_data(), NOTHING_KNOWN
        find_owners(rays, *cells, numbers.box_low, numbers.box_high, zero, owners, scratch)
        with self.opened(job) as scenes:
            flight = Flight([scene.tracers(1)[0] for scene in scenes], 0, len(rays), job.columns)
            flight.land({int(node): rays[owners == node] for node in np.unique(owners)})
            return flight.total
