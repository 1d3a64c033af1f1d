"""An archive into a scene: its spaces and what has moved them, then its records, each where it lay (specs/24-archive.md, Bringing back).

Only places where nothing is are written, and what is there already and the same is kept. So a try that was ended, for whatever
reason, is gone on with by another one, and never harms what somebody else has put there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.copies import Copies, is_so_already, new_copies
from scenefold.client.new_space import new_space
from scenefold.client.progress import ProgressCallback, ProgressState, callback_of
from scenefold.client.reencryption import Pace
from scenefold.client.together import worked_off
from scenefold.client.wishes import Wish
from scenefold.crypto import EXPECTS_NOTHING, signed_place
from scenefold.scene.archive import Archive, ArchivedRecord, ArchivedSpace, position_after
from scenefold.scene.log import LoggedSpace, SceneLog
from scenefold.scene.log.growing import items_of
from scenefold.wire import LogEntry, RenderSettings, ScaleSpace, TranslateSpace
from scenefold.world import World

PHASE = "restore"
VISIBLE = 1
"""The space whose document makes an import visible."""


@dataclass(slots=True)
class RestoreReport:
    """What was brought back. `reused`: records of an earlier try that were kept. `renumbered`: names of spaces, and their new numbers."""

    records: int = 0
    reused: int = 0
    bytes: int = 0
    seconds: float = 0.0
    renumbered: dict[str, int] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "records": self.records,
            "reused": self.reused,
            "bytes": self.bytes,
            "renumbered": dict(self.renumbered),
            "seconds": round(self.seconds, 3),
        }


@dataclass(frozen=True, slots=True)
class _Home:
    """What a space of the archive is in the scene."""

    archived: ArchivedSpace
    id: SpaceId
    created: int
    steps: Sequence[int]
    """The positions of the steps that it has made, which are those of the archive."""


@dataclass(frozen=True, slots=True)
class RestoreOptions:
    """`copies`, `copies_min`: of all spaces; None: as many as each had. `resume`: go on with an import that was ended."""

    copies: int | None = None
    copies_min: int | None = None
    resume: bool = False
    progress: ProgressCallback | bool = False
    bytes_per_s: float | None = None
    """Of payloads, at most."""


AS_IT_WAS = RestoreOptions()


@dataclass(frozen=True, slots=True)
class CheckedArchive:
    """A file that was read to its end, and is good. `copies`: what all spaces shall have, if it is not what they had."""

    archive: Archive
    records: int
    bytes: int
    copies: Copies | None

    def copies_of(self, space: ArchivedSpace) -> Copies:
        return Copies(space.copies, space.copies_min) if self.copies is None else self.copies

    @property
    def born_with(self) -> Copies:
        """What the spaces that every scene has are to begin with: as many as the first of them."""
        return self.copies_of(self.archive.scene.spaces[0])


async def check_archive(world: World, path: Path, options: RestoreOptions) -> CheckedArchive:
    """Read all of it; LocalFault if it is no archive, or another than was written."""
    tell = callback_of(options.progress)
    copies = None if options.copies is None else Copies.checked("the archive", options.copies, options.copies_min)
    if options.copies is None and options.copies_min is not None:
        raise UsageFault("how many copies there shall be is missing", where="copies_min", remedy="give copies, too")
    archive = await world.workers.run("import", Archive, path)
    batches, records, size = archive.batches(), 0, 0
    # A part at a time: who interrupts it waits for no more than that, however large the file is.
    while (batch := await _next(world, batches)) is not None:
        records += len(batch)
        size += sum(len(record.payload) for record in batch)
        tell(ProgressState("check", records, None, f"records, {size / 2**20:.1f} MiB"))
    return CheckedArchive(archive, records, size, copies)


async def _next(world: World, batches: Iterator[list[ArchivedRecord]]) -> list[ArchivedRecord] | None:
    """None: that were all, and they are what the archive says."""
    return await world.workers.run("import", next, batches, None)


def check_new(name: str, known: Sequence[str], options: RestoreOptions) -> None:
    """LocalFault if there is a scene of this name, and it is not said to be a beginning of this one."""
    if name in known and not options.resume:
        remedy = "choose another name, or `--resume` if it is from an import of this archive that was ended"
        raise LocalFault(f"a scene {name!r} exists already", where=f"scene {name}", remedy=remedy)


async def restore(access: SceneAccess, checked: CheckedArchive, options: RestoreOptions) -> RestoreReport:
    """Bring an archive into a scene; see `Scenes.import_archive`."""
    clock, tell = access.calls.world.clock, callback_of(options.progress)
    begun = clock.now()
    report = RestoreReport()
    homes, spaces = {}, checked.archive.scene.spaces
    for done, space in enumerate(spaces):
        tell(ProgressState("spaces", done, len(spaces), "spaces"))
        home = homes[space.id] = await _home(access, space, checked.copies_of(space))
        if home.id != space.id:
            report.renumbered[space.name] = home.id
    tell(ProgressState("spaces", len(spaces), len(spaces), "spaces"))
    await _say_settings(access, checked.archive.scene.render)
    await _Restore(access, homes, Pace(options.bytes_per_s), tell, report, checked.records).put_all(checked.archive)
    report.seconds = clock.now() - begun
    return report


async def _say_settings(access: SceneAccess, wanted: RenderSettings) -> None:
    """What an image is by default; nothing where the archive does not say, or the scene says something by now."""
    if wanted != RenderSettings() and (await access.read_log()).state.render == RenderSettings():
        await access.change_log(lambda log: wanted if log.render == RenderSettings() else log.render)


async def _home(access: SceneAccess, space: ArchivedSpace, wanted: Copies) -> _Home:
    """Make a space as it was, or go on with it; LocalFault if one of this name is another."""
    log = (await access.read_log()).state
    present = _present(log, space)
    if present is None:
        log = (await access.change_log(_creation(space, wanted))).state
    else:
        change = new_copies(present.id, *wanted)
        if not is_so_already(change(log), log):
            log = (await access.change_log(change)).state
    while _missing_steps(log.named(space.name), space):
        log = (await access.change_log(partial(_next_step, space))).state
    made = log.named(space.name)
    return _Home(space, made.id, made.created, [step.position for step in items_of(made.steps)])


def _present(log: SceneLog, space: ArchivedSpace) -> LoggedSpace | None:
    found = next((one for one in log.spaces.values() if one.name == space.name), None)
    if found is not None and (found.parent or ArchivedSpace.of(found).shape != space.shape):
        what = f"the scene has a space {space.name!r} of another shape"
        raise LocalFault(what, where=f"space {found.id}", remedy="bring the archive into a scene of another name")
    return found


def _creation(space: ArchivedSpace, copies: Copies) -> Callable[[SceneLog], LogEntry]:
    """Under its number if that is free."""

    def entry(log: SceneLog) -> LogEntry:
        make = new_space(
            space.name,
            None if space.node_managed else (space.low, space.high),
            dimensions=space.dimensions,
            curve=space.curve,
            node_managed=space.node_managed,
            render_output=space.render_output,
            space_id=None if space.id in log.spaces else space.id,
            copies=copies.copies,
            copies_min=copies.least,
        )
        return make(log)

    return entry


def _missing_steps(present: LoggedSpace, space: ArchivedSpace) -> Sequence[LogEntry]:
    """The steps that the space has not made yet; LocalFault if it has made others."""
    there = [(step.factor, step.offset) for step in items_of(present.steps)]
    wanted = [(step.factor, step.offset) for step in space.steps]
    if there != wanted[: len(there)]:
        what = f"the space {space.name!r} was moved otherwise than in the archive"
        raise LocalFault(what, where=f"space {present.id}", remedy="bring the archive into a scene of another name")
    return [
        TranslateSpace(present.id, offset) if factor == 1.0 else ScaleSpace(present.id, factor) for factor, offset in wanted[len(there) :]
    ]


def _next_step(space: ArchivedSpace, log: SceneLog) -> LogEntry:
    missing = _missing_steps(log.named(space.name), space)
    if not missing:
        remedy = "let one of them come to its end"
        raise LocalFault("somebody else brings the same archive into this scene", where=f"space {space.name}", remedy=remedy)
    return missing[0]


class _Restore:
    def __init__(
        self,
        access: SceneAccess,
        homes: Mapping[SpaceId, _Home],
        pace: Pace,
        progress: ProgressCallback,
        report: RestoreReport,
        total: int,
    ) -> None:
        self._access = access
        self._homes = homes
        self._pace = pace
        self._progress = progress
        self._report = report
        self._total = total

    async def put_all(self, archive: Archive) -> None:
        """All records; those of the space that makes an import visible only once all others are durable."""
        next_batch, batches = partial(_next, self._access.calls.world), archive.batches()
        held = await next_batch(batches)

        async def read(send: trio.MemorySendChannel[list[ArchivedRecord]], *, is_visible: bool) -> None:
            nonlocal held
            while held is not None and (held[0].space == VISIBLE) == is_visible:
                await send.send(held)
                held = await next_batch(batches)

        for is_visible in (False, True):
            await worked_off(partial(read, is_visible=is_visible), self._put_batch, ahead=1)

    async def _put_batch(self, batch: Sequence[ArchivedRecord]) -> None:
        clock, report = self._access.calls.world.clock, self._report
        size = sum(len(record.payload) for record in batch)
        await clock.sleep(self._pace.wait_s(clock.now(), size))
        reused = await self._put(batch)
        report.reused += reused
        report.records += len(batch)
        report.bytes += size
        self._progress(ProgressState(PHASE, report.records, self._total, f"records, {report.bytes / 2**20:.1f} MiB"))

    async def _put(self, batch: Sequence[ArchivedRecord]) -> int:
        """Store what is not there; how much was."""
        wishes = [self._wish(record) for record in batch]
        placed = await self._access.put(wishes)
        taken = [wish for wish, outcome in zip(wishes, placed, strict=True) if outcome.reason == RejectReason.STALE_VERSION]
        for wish, found in zip(taken, await self._access.get([wish.key for wish in taken]) if taken else [], strict=True):
            if found is None or (found.payload, found.content_position) != (wish.payload, wish.content_position):
                remedy = "bring the archive into a scene of another name"
                raise LocalFault("another record lies there than in the archive", where=self._access.where(wish), remedy=remedy)
        return len(taken)

    def _wish(self, record: ArchivedRecord) -> Wish:
        home = self._homes[record.space]
        place = Location(signed_place(record.object)) if record.object else record.location
        position = position_after(record.content_position, home.archived.steps, home.created, home.steps)
        return Wish(home.id, place, record.payload, EXPECTS_NOTHING, position, record.object)
