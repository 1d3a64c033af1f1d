"""What a member has its worker threads do with a tracer: make the camera rays of a pass, and trace heaps of several passes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenefold.render.arrays import U32
from scenefold.render.contract import Advanced, Tracer
from scenefold.render.film import GoesOn
from scenefold.render.job import Job
from scenefold.render.pass_sums import PassSums


def camera_rays(tracer: Tracer, job: Job, number: int, goes_on: GoesOn) -> dict[int, U32]:
    """Of the paths of a pass whose pixels go on (all, if there are no rows of them), by the node that casts each first."""
    plan, pixels = job.plan, job.window.pixels
    first = plan.first_path(number)
    rays = tracer.generate(first, plan.size(number))
    if not len(goes_on):
        return rays
    kept = {node: some[goes_on[(first + (some[:, 7] >> np.uint32(16)).astype(np.int64)) % pixels] != 0] for node, some in rays.items()}
    return {node: some for node, some in kept.items() if len(some)}


def advanced(tracer: Tracer, batches: Sequence[tuple[U32, int, PassSums]]) -> list[Advanced]:
    """Of each batch: its rays, the first path of its pass, the sums of this. One hand-over for all."""
    return [tracer.advance(*batch) for batch in batches]
