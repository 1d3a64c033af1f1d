"""`render still FILE --memory`: no cluster, but this process, and trees of a few parts of the scene at a time (specs/27-out-of-core.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scenectl.still import Phases, StillJob, render_progress, write_image

if TYPE_CHECKING:
    from scenefold.client.progress import ProgressCallback


async def make_within(memory: int, job: StillJob, progress: ProgressCallback) -> dict[str, Any]:
    """Do the whole job within so many bytes, and return its report (docs/reference/scenectl.md, *Report of an image*)."""
    import trio

    from scenefold.base.kernel_cache import use_kernel_cache

    use_kernel_cache()
    from scenefold.render.out_of_core.still import OutOfCore, render_within

    assert job.file is not None
    phases = Phases()
    options = job.options.checked()
    asked = OutOfCore(file=job.file, memory=memory, threads=job.threads or 1, moment=job.moment, environment=job.environment)
    made = await render_within(asked, options, render_progress(progress))
    phases.seconds.update(made.report["render_seconds"])
    with phases.time("write"):
        written = await trio.to_thread.run_sync(write_image, job.scene_name, job.files, options, made.layers, job.options.exposure)
    return {
        "scene": job.scene_name,
        "file": str(job.file),
        "time": None if job.moment is None else job.moment.time_s,
        "nodes": 0,
        "records_per_node": None,
        "import": {"not_carried": list(made.not_carried)},
        **made.report,
        "left_out": [],
        **written,
        "seconds": phases.seconds,
    }
