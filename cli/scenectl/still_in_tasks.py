"""`render still --partition visual|temporal`: no pool, but tasks that read the scene from its store (specs/32-partitions.md)."""

from __future__ import annotations

import os
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from scenectl.partition_options import numbered
from scenectl.replacing import tell_replaced
from scenectl.still import ImageFiles, Phases, StillJob, write_image

if TYPE_CHECKING:
    from scenectl.partition_options import Frames
    from scenefold.client import Cluster, ImportReport, Scene
    from scenefold.client.progress import ProgressCallback
    from scenefold.render.job import RenderOptions
    from scenefold.render.layers import Pixels
    from scenefold.render.tasks.rendering import Progress, Workers
    from scenefold.render.tasks.sources import Source


@dataclass(frozen=True, kw_only=True)
class InTasks:
    """How the work is shared out."""

    partition: str
    engine: str | None
    """Address of a Dask scheduler; None: threads of this process."""
    trust_network: bool = False
    """Whether that may be one by tcp on another computer."""
    frames: Frames | None = None
    fps: float | None = None
    animation: str | None = None


class _Ready(NamedTuple):
    """What can be rendered."""

    source: Source
    options: RenderOptions
    exposure: float | None
    content: bytes | None
    nodes: tuple[str, ...]
    """Addresses, of the cluster that holds the scene; none: no cluster does."""
    imported: ImportReport | None = None
    """How the file came into it."""


async def make_in_tasks(job: StillJob, how: InTasks, progress: ProgressCallback) -> dict[str, Any]:
    """Do the whole job, and return its report (docs/reference/scenectl.md, *Report of an image*)."""
    from scenefold.peer.settings import processors
    from scenefold.render.tasks.engine import check_installed, checked_address
    from scenefold.render.tasks.rendering import Workers

    is_secret, is_trusted = job.profile is not None, how.trust_network
    address = None if how.engine is None else checked_address(how.engine, is_secret=is_secret, is_network_trusted=is_trusted)
    check_installed(address)
    workers = Workers(threads=job.threads or processors(), address=address, is_secret=is_secret)
    phases, tell = Phases(), _task_progress(progress)
    async with _ready(job, phases, progress) as ready:
        if how.partition == "visual":
            made = await _one_image(job, ready, workers, tell, phases)
        else:
            made = await _frames(job, how, ready, workers, tell, phases)
    return {
        "scene": job.scene_name,
        "file": None if job.file is None else str(job.file),
        "time": None if job.moment is None else job.moment.time_s,
        "nodes": len(ready.nodes),
        "records_per_node": None if ready.imported is None else {node: ready.imported.records_by_node.get(node, 0) for node in ready.nodes},
        **made,
        "left_out": [],
        "seconds": phases.seconds,
    }


async def _one_image(job: StillJob, ready: _Ready, workers: Workers, tell: Progress, phases: Phases) -> dict[str, Any]:
    from scenefold.render.tasks.rendering import render_visual
    from scenefold.world import offline_world

    with phases.time("render"):
        made = await render_visual(ready.source, ready.options, workers, tell, ready.content)
    with phases.time("write"):
        write = partial(write_image, job.scene_name, job.files, ready.options, made.layers, ready.exposure)
        written = await offline_world().workers.run("import", write)
    return {"import": _imported(job, ready, made.not_carried), **made.report, **written}


async def _frames(job: StillJob, how: InTasks, ready: _Ready, workers: Workers, tell: Progress, phases: Phases) -> dict[str, Any]:
    from scenefold.render.tasks.rendering import render_temporal

    numbers = None if how.frames is None else how.frames.numbers
    sources = [ready.source] if numbers is None else [_at(ready.source, number, how) for number in numbers]
    files = [job.files] if numbers is None else [files_of(job.files, number) for number in numbers]
    written: dict[int, dict[str, Any]] = {}
    left: dict[str, None] = {}

    def made(index: int, layers: dict[str, Pixels], not_carried: tuple[str, ...]) -> None:
        written[index] = write_image(job.scene_name, files[index], ready.options, layers, ready.exposure)
        left.update(dict.fromkeys(not_carried))

    begun = time.monotonic()
    report = await render_temporal(sources, ready.options, workers, tell, made, ready.content)
    took, rendering = time.monotonic() - begun, sum(report["render_seconds"].values())
    # Most frames are written while others are made.
    phases.seconds |= {"render": round(rendering, 3), "write": round(max(took - rendering, 0.0), 3)}
    document = {"import": _imported(job, ready, tuple(left)), **report}
    if numbers is None:
        return document | written[0]
    return document | frames_written([(number, written[index]) for index, number in enumerate(numbers)])


def frames_written(frames: Sequence[tuple[int, dict[str, Any]]]) -> dict[str, Any]:
    """What the report of several frames says of their files: what is the same for all, and a row for each. `frames`: numbers, and what `write_image` said."""
    of_frame = ("image_sha256", "exr", "png", "exposure", "pixels_not_finite")
    rows = [{"frame": number} | {name: written[name] for name in of_frame} for number, written in frames]
    return {name: value for name, value in frames[0][1].items() if name not in of_frame} | {"frames": rows}


def frames_text(report: dict[str, Any]) -> str:
    """The report of several frames as a short table for people."""
    frames = report["frames"]
    last = frames[-1]
    seconds = ", ".join(f"{phase} {value:.1f}" for phase, value in report["seconds"].items())
    rows = (
        ("samples per pixel", f"{report['samples_per_pixel']:,.3g}"),
        ("paths/s", f"{report['paths_per_second']:,.0f}"),
        ("processes that rendered" if report["partition"] != "spatial" else "nodes that rendered", len(report["render_nodes"])),
        ("efficiency", f"{report['efficiency']:.3f}"),
        ("seconds", seconds),
    )
    lines = [f"{len(frames):,} frames are written, {frames[0]['exr']} to {last['exr']}, each with a PNG beside it."]
    lines += [f"  {label + ':':<28}{value}" for label, value in rows]
    lines += [f"  not carried over: {missing}" for missing in (report["import"] or {}).get("not_carried", [])]
    return "\n".join(lines)


@asynccontextmanager
async def _ready(job: StillJob, phases: Phases, progress: ProgressCallback) -> AsyncIterator[_Ready]:
    """Who reads it, and with which options; while this lasts a cluster in render mode stays in it."""
    from scenefold.render.tasks.sources import ClusterScene, SceneFile
    from scenefold.scene.importers import AT_REST

    if job.profile is None:
        assert job.file is not None
        environment = None if job.environment is None else job.environment.absolute()
        file = SceneFile(job.file.absolute(), job.moment or AT_REST, environment)
        yield _Ready(file, job.options.checked(), job.options.exposure, None, ())
        return
    from scenectl.passphrases import known_passphrase
    from scenectl.running import connected
    from scenefold.base.errors import LocalFault

    async with AsyncExitStack() as stack:
        cluster = await stack.enter_async_context(connected(job.profile))
        scene, imported = await _scene(job, cluster, phases, progress)
        said = job.options.heeded((await scene.render_settings()).settings)
        await stack.enter_async_context(cluster.calls.leases.rendering(scene.access))
        content = await scene.content()
        if content is None:
            raise LocalFault("the scene is empty", where=job.scene_name, remedy="import a file into it first: scenectl scene import")
        exposure = job.options.exposure if job.options.exposure is not None else said.exposure
        source = ClusterScene(_profile_of(job.profile), job.scene_name, known_passphrase)
        nodes = tuple(node.address for node in await cluster.nodes())
        yield _Ready(source, job.options.checked(said), exposure, content.digest, nodes, imported)


async def _scene(job: StillJob, cluster: Cluster, phases: Phases, progress: ProgressCallback) -> tuple[Scene, ImportReport | None]:
    from scenefold.client import prepare_import

    if job.file is None:
        return await cluster.scenes.open(job.scene_name), None
    with phases.time("read"):
        prepared = await prepare_import(cluster.calls.world, job.file, progress, job.moment, job.environment)
    prepared.check_camera(job.options.camera)
    with phases.time("import"):
        return await cluster.scenes.import_prepared(job.scene_name, prepared, progress, replacing=tell_replaced(job.scene_name))


def _profile_of(profile: str) -> str:
    """As tasks find it: a name is one on any computer, a folder has a path."""
    return os.path.abspath(profile) if os.path.isdir(profile) else profile  # noqa: PTH100, PTH112  text in, text out


def _at(source: Source, frame: int, how: InTasks) -> Source:
    from scenefold.render.tasks.sources import SceneFile
    from scenefold.scene.importers import FPS_USUAL, moment_of_frame

    assert isinstance(source, SceneFile), "frames are of a file"
    return replace(source, moment=moment_of_frame(frame, FPS_USUAL if how.fps is None else how.fps, how.animation))


def files_of(files: ImageFiles, frame: int) -> ImageFiles:
    return replace(files, exr=numbered(files.exr, frame), png=numbered(files.png, frame))


def _imported(job: StillJob, ready: _Ready, not_carried: tuple[str, ...]) -> dict[str, Any] | None:
    """What of a file could not be carried over: as its import into the cluster says, or, if there is none, as those did who read it."""
    if ready.imported is not None:
        return ready.imported.document()
    return None if job.file is None else {"not_carried": list(not_carried)}


def _task_progress(progress: ProgressCallback) -> Progress:
    from scenefold.client import ProgressState

    units = {"prepare": "engine", "render": "tasks"}
    return lambda phase, done, total: progress(ProgressState(phase, done, total, units[phase]))
