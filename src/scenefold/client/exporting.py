"""A scene into an archive: all that lives in it, read space by space and written as it comes (specs/24-archive.md).

a task:        list, read, verify, open ... a batch of records at a time
    |  bounded channel: memory holds a few batches, whatever the size of the scene
import lane:   write them behind each other; the file gets its name when it is whole
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import trio

from scenefold.base.location import FIRST, LAST
from scenefold.client.access import SceneAccess
from scenefold.client.progress import ProgressCallback, ProgressState, no_progress
from scenefold.client.ranging import entries
from scenefold.client.reencryption import Pace
from scenefold.client.sealing import Opened
from scenefold.client.together import worked_off
from scenefold.client.verifying import Key
from scenefold.scene.archive import BATCH, ArchivedRecord, ArchivedScene, ArchivedSpace, NewArchive, check_free

_SEQ_A_SECOND = 1_000_000
PHASE = "export"


@dataclass(slots=True)
class ExportReport:
    """What was archived. `listed`: records that there were, deleted ones among them."""

    listed: int = 0
    records: int = 0
    bytes: int = 0
    seconds: float = 0.0
    dry_run: bool = False
    spaces: dict[str, int] = field(default_factory=dict)
    """Of each space, by name: how many were archived, or with `dry_run` listed."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "dry_run": self.dry_run,
            "listed": self.listed,
            "records": self.records,
            "bytes": self.bytes,
            "spaces": dict(self.spaces),
            "seconds": round(self.seconds, 3),
        }


async def export_scene(
    access: SceneAccess, path: Path, progress: ProgressCallback = no_progress, bytes_per_s: float | None = None, *, dry_run: bool = False
) -> ExportReport:
    """Write all records that live in the scene, and what its log says of its spaces, to a new file; see `Scene.export`."""
    run, clock = access.calls.world.workers.run, access.calls.world.clock
    await run("import", check_free, path)
    begun = clock.now()
    scene = await _described(access)
    work = _Export(access, scene, Pace(bytes_per_s), progress, ExportReport(dry_run=dry_run))
    await work.count()
    if not dry_run:
        with trio.CancelScope(shield=True):
            archive = await run("import", NewArchive, path)
        try:
            await work.write(archive)
            await run("import", archive.finish)
        finally:
            with trio.CancelScope(shield=True):
                await run("import", archive.abandon)
    work.report.seconds = clock.now() - begun
    return work.report


async def _described(access: SceneAccess) -> ArchivedScene:
    """The scene by its newest log."""
    log = (await access.read_log()).state
    spaces = tuple(ArchivedSpace.of(space) for space in log.spaces.values() if not space.parent)
    identity = access.identity
    return ArchivedScene(
        access.name, f"{identity.scene:08x}", identity.genesis.hex(), log.position, log.mode.name.lower(), spaces, log.render
    )


class _Export:
    def __init__(self, access: SceneAccess, scene: ArchivedScene, pace: Pace, progress: ProgressCallback, report: ExportReport) -> None:
        self.report = report
        self._access = access
        self._scene = scene
        self._pace = pace
        self._progress = progress
        self._total = 0

    async def count(self) -> None:
        """How many records are listed, for whoever wants to know how long it takes. Which are deleted only who reads them can tell."""
        for space in self._scene.order:
            before = self.report.listed
            async with aclosing(self._listed(space)) as listed:
                async for keys in listed:
                    self.report.listed += len(keys)
                    self._progress(ProgressState("count", self.report.listed, None, "records"))
            self.report.spaces[space.name] = self.report.listed - before

    async def write(self, archive: NewArchive) -> None:
        """All records, in the order of the archive."""
        run = self._access.calls.world.workers.run
        self._total, self.report.listed = self.report.listed, 0
        await run("import", archive.begin, self._scene)
        await worked_off(self._read, partial(run, "import", archive.add), workers=1, ahead=1)

    async def _read(self, send: trio.MemorySendChannel[list[ArchivedRecord]]) -> None:
        report = self.report
        for space in self._scene.order:
            before, met = report.records, set[bytes]()
            async with aclosing(self._listed(space)) as listed:
                async for keys in listed:
                    # An object that slides meanwhile is listed twice.
                    fresh = [key for key in keys if len(key) == 2 or key[2] not in met]
                    met.update(key[2] for key in fresh if len(key) == 3)
                    records = await self._living(fresh)
                    if records:
                        await send.send(records)
                    size, total = f"{report.bytes / 2**20:.1f} MiB", max(self._total, report.listed)
                    self._progress(ProgressState(PHASE, report.listed, total, f"records, {size}, in space {space.name}"))
            report.spaces[space.name] = report.records - before

    async def _living(self, keys: Sequence[Key]) -> list[ArchivedRecord]:
        """Those of these records that are not deleted."""
        clock, report = self._access.calls.world.clock, self.report
        opened = await self._access.get(keys)
        records = [_archived(key, one) for key, one in zip(keys, opened, strict=True) if one is not None and not one.deleted]
        size = sum(len(record.payload) for record in records)
        report.listed += len(keys)
        report.records += len(records)
        report.bytes += size
        await clock.sleep(self._pace.wait_s(clock.now(), size))
        return records

    async def _listed(self, space: ArchivedSpace) -> AsyncGenerator[list[Key], None]:
        """The records of a space, a batch at a time, deleted ones among them."""
        access = self._access
        batch: list[Key] = []
        async with aclosing(entries(access.calls, access.identity.scene, space.id, FIRST, LAST, stale_ok=False)) as listed:
            async for location, object_id in listed:
                if bool(object_id) == space.node_managed:
                    batch.append((space.id, location, object_id) if object_id else (space.id, location))
                if len(batch) == BATCH:
                    yield batch
                    batch = []
        if batch:
            yield batch


def _archived(key: Key, found: Opened) -> ArchivedRecord:
    object_id = key[2] if len(key) == 3 else b""
    return ArchivedRecord(key[0], key[1], object_id, found.content_position, found.payload, found.seq // _SEQ_A_SECOND)
