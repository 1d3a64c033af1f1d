"""A file into a scene: planned in threads, streamed through a bounded channel, made visible by the last record.

    import lane:  read the file, cut atoms ... a batch of records at a time
        |  bounded channel: memory holds a few batches, whatever the size of the file
    a few tasks:  seal, send, wait until durable (put_fresh), tell the plan what moved
        |  all of a phase before the next, because tables name the places of records
    the document: the only record that replaces another, and the only way to find the others

So an import that ends early, for whatever reason, changes nothing that anybody sees, and giving it again
continues it: records that are there already are kept.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import trio

from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_FRAME_BYTES, CLIENT_FRAME_RECORDS
from scenefold.client.access import SceneAccess
from scenefold.client.contents import check_camera, content_of
from scenefold.client.free_places import FreePlaces
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.progress import ProgressCallback, ProgressState
from scenefold.client.reencryption import Pace
from scenefold.client.together import worked_off
from scenefold.client.wishes import Wish
from scenefold.world import World

if TYPE_CHECKING:
    from scenefold.scene.importers import ImportItem, ImportPlan, Moment
    from scenefold.scene.payloads.document import SceneDocument

_UNITS = {"geometry": "triangles", "textures": "tiles", "tables": "pages"}


@dataclass(slots=True)
class ImportReport:
    """What an import did. `reused`: records of an earlier, interrupted import that were kept. `seconds`: of reading and storing."""

    records: int = 0
    reused: int = 0
    bytes: int = 0
    seconds: float = 0.0
    records_by_node: dict[str, int] = field(default_factory=dict)
    content_sha256: str = ""
    not_carried: tuple[str, ...] = ()
    replaced: str = ""
    """The source of what the scene showed before, if that was something else; its records stay."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "records": self.records,
            "reused": self.reused,
            "bytes": self.bytes,
            "seconds": round(self.seconds, 3),
            "records_by_node": dict(sorted(self.records_by_node.items())),
            "content_sha256": self.content_sha256,
            "not_carried": list(self.not_carried),
            "replaced": self.replaced,
        }


class _Batch(NamedTuple):
    """Some records, and how far the plan was when they were made."""

    items: list[ImportItem]
    mark: ProgressState | None


class _Marks:
    """Where the plan stands: written by it in a worker thread, read on Trio's; a single reference, so never torn."""

    def __init__(self) -> None:
        self.latest: ProgressState | None = None

    def __call__(self, phase: str, done: int, total: int) -> None:
        self.latest = ProgressState(phase, done, total, _UNITS.get(phase, "records"))


@dataclass(frozen=True, slots=True)
class PreparedImport:
    """A file that was read and found good; nothing is stored yet."""

    plan: ImportPlan
    marks: _Marks
    read_seconds: float
    """How long reading took. Not when it began: a cluster may be started between reading and storing."""

    def totals(self) -> tuple[int, int]:
        """How many records it makes, and of how many bytes. It takes as long as making them, and is for who stores none of them."""
        sizes = [len(item.payload) for item in self.plan.items()]
        return len(sizes), sum(sizes)

    def check_camera(self, name: str | None) -> None:
        """LocalFault if the scene will not have this camera; None is the one that it shows itself by."""
        if name is not None:
            check_camera(name, self.plan.camera_names)


async def prepare_import(
    world: World, path: Path, progress: ProgressCallback, moment: Moment | None = None, environment: Path | str | None = None
) -> PreparedImport:
    """Read a file, at a moment of its animations (None: at rest), and its environment map, in a worker thread; LocalFault says what is wrong with it."""
    from scenefold.scene.importers import AT_REST, plan_import, read_scene

    begun = world.clock.now()
    progress(ProgressState("read", 0, 1, "file"))
    source = await world.workers.run("import", read_scene, path, moment or AT_REST, environment)
    marks = _Marks()
    plan = await world.workers.run("import", plan_import, source, marks)
    progress(ProgressState("read", 1, 1, "file"))
    return PreparedImport(plan, marks, world.clock.now() - begun)


async def store_import(
    access: SceneAccess,
    prepared: PreparedImport,
    progress: ProgressCallback,
    bytes_per_s: float | None = None,
    replacing: Callable[[SceneDocument], None] | None = None,
) -> ImportReport:
    """Store a prepared file as the scene's content; see `Scene.import_file`. `replacing`: told before that of what the scene shows until then."""
    plan, clock = prepared.plan, access.calls.world.clock
    begun = clock.now()
    before = await content_of(access)
    if before is not None and replacing is not None:
        replacing(before)
    work = _Import(access, plan, prepared.marks, progress, Pace(bytes_per_s))
    for phase in plan.phases():
        await work.put_phase(phase)
    report = work.report
    report.seconds = prepared.read_seconds + clock.now() - begun
    now = plan.document()
    report.content_sha256 = now.content.hex()
    if before is not None and (before.content, before.records) != (now.content, now.records):
        report.replaced = before.source
    report.not_carried = plan.not_carried
    return report


def scene_name_of(text: str) -> str:
    """A scene's name made of any text: what a name may not hold becomes '_'."""
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", text).lstrip("-.")[:64]
    return name or "scene"


class _Import:
    def __init__(self, access: SceneAccess, plan: ImportPlan, marks: _Marks, progress: ProgressCallback, pace: Pace) -> None:
        self.report = ImportReport()
        self._access = access
        self._plan = plan
        self._marks = marks
        self._progress = progress
        self._pace = pace
        self._places = FreePlaces()
        self._shown: ProgressState | None = None

    async def put_phase(self, items: Iterator[ImportItem]) -> None:
        """Store all items of a phase; they are durable, and the plan knows where they are, when this returns."""
        await worked_off(partial(self._make_batches, items), self._put_batch, ahead=1)

    async def _make_batches(self, items: Iterator[ImportItem], send: trio.MemorySendChannel[_Batch]) -> None:
        while batch := await self._access.calls.world.workers.run("import", _take, items):
            await send.send(_Batch(batch, self._marks.latest))

    async def _put_batch(self, batch: _Batch) -> None:
        clock = self._access.calls.world.clock
        await clock.sleep(self._pace.wait_s(clock.now(), sum(len(item.payload) for item in batch.items)))
        await self._put_document([item for item in batch.items if item.replaces])
        await self._put_records([item for item in batch.items if not item.replaces])
        self._show(batch.mark)

    async def _put_records(self, items: list[ImportItem]) -> None:
        fresh = [FreshItem(item.space, item.location, item.payload) for item in items]
        for item, stored in zip(items, await put_fresh(self._access, fresh, self._places), strict=True):
            if stored.location != item.location:
                self._plan.moved(item, stored.location)
            self._count(item, stored.node, reused=stored.reused)

    async def _put_document(self, items: list[ImportItem]) -> None:
        placed = await self._access.put([Wish(item.space, item.location, item.payload) for item in items])
        for item, outcome in zip(items, placed, strict=True):
            self._count(item, outcome.node, reused=False)

    def _count(self, item: ImportItem, node: NodeId, *, reused: bool) -> None:
        address = self._access.calls.address_of(node)
        by_node = self.report.records_by_node
        by_node[address] = by_node.get(address, 0) + 1
        self.report.records += 1
        self.report.reused += reused
        self.report.bytes += len(item.payload)

    def _show(self, mark: ProgressState | None) -> None:
        """Batches finish in any order; what is shown only rises."""
        shown = self._shown
        if mark is not None and (shown is None or shown.phase != mark.phase or shown.done < mark.done):
            self._shown = mark
            self._progress(mark)


def _take(items: Iterator[ImportItem]) -> list[ImportItem]:
    """The next items, about as many as fit a frame; none at the end. Short, so that an import can be stopped."""
    batch: list[ImportItem] = []
    size = 0
    for item in items:
        batch.append(item)
        size += len(item.payload)
        if size >= CLIENT_FRAME_BYTES or len(batch) >= CLIENT_FRAME_RECORDS:
            break
    return batch
