"""`render still FILE --frames A-B` by nodes: one frame after the other, each by all nodes; while one is rendered the next one is imported.

What frames have in common is stored once, as long as they are of one scene: two scenes take them in turn. Once what a scene holds of former frames
is several times what it shows, it is ended, and its nodes drop all of it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import trio

from scenectl.output import note
from scenectl.still import Phases, StillJob, cluster_of, rendered, write_image
from scenectl.still_in_tasks import files_of, frames_written

if TYPE_CHECKING:
    from scenectl.partition_options import Frames
    from scenefold.client import Cluster, ImportReport, PreparedImport, Scene
    from scenefold.client.progress import ProgressCallback
    from scenefold.node.local import LocalCluster
    from scenefold.scene.importers import Moment

LANES = ("even", "odd")
"""One scene is rendered, the other one imported."""
GROWTH_MAX = 4
"""What a scene holds of former frames, over what its first frame has, until another one takes its place."""


@dataclass(frozen=True, kw_only=True)
class FrameTimes:
    """Which frames of a file, and when each is."""

    frames: Frames
    fps: float | None = None
    animation: str | None = None

    def moment(self, frame: int) -> Moment:
        """Of a frame."""
        from scenefold.scene.importers import FPS_USUAL, moment_of_frame

        return moment_of_frame(frame, FPS_USUAL if self.fps is None else self.fps, self.animation)


@dataclass(frozen=True, slots=True)
class _Frame:
    """One that is in the cluster."""

    number: int
    scene: Scene
    lane: _Lane


class _Lane:
    """A scene that shows one frame after the other, and is replaced by a new one once in a while."""

    def __init__(self, cluster: Cluster, name: str) -> None:
        self._cluster = cluster
        self._name = name
        self._made = 0
        self._scene: Scene | None = None
        self._first = self._former = 0
        """Records that it has stored: of its first frame, and of those since."""
        self._to_end: list[Scene] = []

    async def take(self, prepared: PreparedImport, progress: ProgressCallback) -> tuple[Scene, ImportReport]:
        """Import the next frame."""
        if self._scene is not None and self._former > GROWTH_MAX * self._first:
            self._to_end.append(self._scene)
            self._scene = None
        await self._end()
        if self._scene is None:
            self._made += 1
            # It ends with this cluster, whose nodes have one disk: copies save from nothing but the death of a single node.
            self._scene = await self._cluster.scenes.create(self._scene_name, copies=1)
            self._first = self._former = 0
        scene, report = await self._cluster.scenes.import_prepared(self._scene_name, prepared, progress)
        fresh = report.records - report.reused
        if self._first:
            self._former += fresh
        else:
            self._first = max(fresh, 1)
        return scene, report

    @property
    def _scene_name(self) -> str:
        return f"{self._name}-{self._made}"

    async def _end(self) -> None:
        """Scenes that nobody reads any more; one for which a lease is not over yet is ended with the next frame."""
        from scenefold.base.errors import Refused
        from scenefold.base.reasons import RejectReason

        waiting = []
        for scene in self._to_end:
            try:
                await scene.end()
            except Refused as refused:
                if refused.reason is not RejectReason.BUSY:
                    raise
                waiting.append(scene)
        self._to_end = waiting


@dataclass
class _Made:
    """What came of the frames so far."""

    reports: list[dict[str, Any]] = field(default_factory=list)
    written: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    not_carried: dict[str, None] = field(default_factory=dict)


async def make_frames(job: StillJob, how: FrameTimes, progress: ProgressCallback) -> dict[str, Any]:
    """All frames, in order; the report of all (docs/reference/scenectl.md, *Report of an image*)."""
    from scenefold.render.frame_reports import report_of_frames
    from scenefold.world import background_tasks

    phases, made = Phases(), _Made()
    with phases.time("read"):
        # Before any node is started: a file that cannot be used should not cost more than its reading.
        first = await _prepared(job, how, how.frames.first, progress)
    async with cluster_of(job, phases) as (cluster, embedded), background_tasks() as nursery:
        send, receive = trio.open_memory_channel[_Frame](0)
        give_back, idle = trio.open_memory_channel[_Lane](len(LANES))
        for name in LANES:
            give_back.send_nowait(_Lane(cluster, name))
        nursery.start_soon(_import_all, job, how, first, idle, send, made, progress)
        del first
        if embedded is not None:
            embedded.may_die(embedded.addresses)
        shown = _progress_of_frames(progress, how.frames.numbers)
        with _telling_what_is_there(how.frames, made):
            while len(made.written) < len(how.frames.numbers):
                with phases.time("import"):
                    frame = await receive.receive()
                await _make(job, frame, embedded, cluster, phases, made, shown)
                await give_back.send(frame.lane)
        nodes = [node.address for node in await cluster.nodes()]
        if embedded is not None:
            embedded.may_die(())
    return {
        "scene": job.scene_name,
        "file": str(job.file),
        "time": None,
        "nodes": len(nodes),
        "records_per_node": None,
        "import": {"not_carried": list(made.not_carried)},
        **report_of_frames(made.reports),
        **frames_written(made.written),
        "seconds": phases.seconds,
    }


@contextmanager
def _telling_what_is_there(frames: Frames, made: _Made) -> Iterator[None]:
    """However it ends: who has some of the frames need not make them again."""
    try:
        yield
    finally:
        if 0 < len(made.written) < len(frames.numbers):
            newest = made.written[-1][0]
            note(f"note: frames {frames.first} to {newest} are written: --frames {newest + 1}-{frames.last} goes on behind them")


async def _import_all(
    job: StillJob,
    how: FrameTimes,
    first: PreparedImport,
    idle: trio.MemoryReceiveChannel[_Lane],
    send: trio.MemorySendChannel[_Frame],
    made: _Made,
    progress: ProgressCallback,
) -> None:
    """Each frame into a scene that nobody renders. The first one is prepared already."""
    from scenefold.client.progress import no_progress

    prepared: PreparedImport | None = first
    del first
    for number in how.frames.numbers:
        lane = await idle.receive()
        # People watch how the first one comes in; then they watch how frames are rendered.
        tell = progress if prepared is not None else no_progress
        if prepared is None:
            prepared = await _prepared(job, how, number, tell)
        scene, report = await lane.take(prepared, tell)
        prepared = None
        made.not_carried.update(dict.fromkeys(report.not_carried))
        await send.send(_Frame(number, scene, lane))


async def _prepared(job: StillJob, how: FrameTimes, number: int, progress: ProgressCallback) -> PreparedImport:
    from scenefold.client import prepare_import
    from scenefold.world import offline_world

    assert job.file is not None, "frames are of a file"
    prepared = await prepare_import(offline_world(), job.file, progress, how.moment(number), job.environment)
    prepared.check_camera(job.options.camera)
    return prepared


async def _make(
    job: StillJob,
    frame: _Frame,
    embedded: LocalCluster | None,
    cluster: Cluster,
    phases: Phases,
    made: _Made,
    progress: Callable[[int, str, int, int], None],
) -> None:
    """Render one frame, and write it."""
    place = len(made.written)
    with phases.time("render"):
        result = await rendered(job, embedded, cluster, frame.scene, lambda phase, done, total: progress(place, phase, done, total))
    with phases.time("write"):
        files = files_of(job.files, frame.number)
        one = await cluster.in_worker("import", write_image, job.scene_name, files, result.options, result.layers, result.exposure)
    made.reports.append(result.report)
    made.written.append((frame.number, one))


def _progress_of_frames(progress: ProgressCallback, frames: Sequence[int]) -> Callable[[int, str, int, int], None]:
    """By the place of a frame among all: how far it is, and how long all that is left will take."""
    from scenefold.client import ProgressState

    begun = time.monotonic()

    def tell(place: int, phase: str, done: int, total: int) -> None:
        if phase != "render" or not total:
            return
        share = (place + done / total) / len(frames)
        left_s = (time.monotonic() - begun) * (1.0 - share) / share if share else None
        progress(ProgressState("render", done, total, f"passes of frame {frames[place]}, {place + 1} of {len(frames)}", left_s))

    return tell
