"""How fast a renderer is on one thread of this machine: the first half of `scenectl bench render`.

The other half, what a cluster costs, needs nodes and lives with the verb.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.render.contract import MeasuredRenderer, load_renderer
from scenefold.render.in_memory import LANE, one_node_job
from scenefold.render.job import RenderOptions
from scenefold.world import Workers

CAPTURED_RAYS_MAX = 4_000_000
"""Rays that the bare rate is measured on, but the rest of a pass is always taken along."""


async def measure_renderer(
    file: Path, options: RenderOptions, workers: Workers, *, renderer: str = "embree", repetitions: int = 3
) -> dict[str, Any]:
    """Measure on a scene file; LocalFault if the file cannot be used or the renderer cannot be measured."""
    measured = load_renderer(renderer)
    if not isinstance(measured, MeasuredRenderer):
        raise LocalFault(f"the renderer {renderer!r} does not measure itself", remedy="measure embree")
    one = await one_node_job(file, options, measured.numeric_class(), workers)
    loaded = one.loaded
    report = await workers.run(LANE, measured.measure, loaded.held, loaded.numbers, one.job.partition, repetitions, CAPTURED_RAYS_MAX)
    return {"renderer": renderer, "numeric_class": one.job.numeric_class, "triangles": loaded.share.instanced_triangles, **report}
