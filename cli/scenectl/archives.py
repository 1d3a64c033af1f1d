"""`scenectl scene export`, `scene import-archive`: a scene in one file that needs no cluster, and back (specs/24-archive.md)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.copies import CopiesOption, MinCopiesOption
from scenectl.errors import Interrupted
from scenectl.names import SceneName, SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, size_text

if TYPE_CHECKING:
    from scenefold.client import ExportReport, RestoreReport

DryRun = Annotated[bool, Parameter(negative="", show_default=False)]
Flag = Annotated[bool, Parameter(negative="", show_default=False)]
GOES_ON = "the same command with --resume goes on"


def export(
    scene: SceneName,
    file: Path,
    /,
    *,
    rate: float | None = None,
    dry_run: DryRun = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Write all that a scene holds to one file that `tar` reads: its spaces, and every record of them, NOT encrypted.

    The file is there once all of it is, and not before; what is there already is never written over. Who may use the scene, keys, copies, deleted records and older versions are not in it. A scene that must be of one moment has to be in render mode meanwhile.

    Example: scenectl scene export kitchen kitchen.tar --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    file
        The file to make, readable by you alone.
    rate
        MiB that are read in a second, at most, so that others can work meanwhile; by default as fast as it goes.
    dry_run
        Count the records, deleted ones among them, and write nothing.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run

    speed = bytes_per_s(rate)

    async def work(progress: Progress) -> ExportReport:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await opened.export(file, progress, speed, dry_run=dry_run)

    with Progress(quiet=output.json) as progress:
        report = run(work, progress)
    if dry_run:
        text = f"Scene {scene} has {report.listed} records, deleted ones among them."
    else:
        text = f"Scene {scene} is in {file}: {report.records} records, {size_text(report.bytes)}, {report.seconds:.1f} s. Nothing in it is encrypted."
    emit(output, {"scene": scene, "file": str(file), **report.document()}, text)


def import_archive(
    file: Path,
    /,
    *,
    scene: SceneOption | None = None,
    copies: CopiesOption | None = None,
    min_copies: MinCopiesOption | None = None,
    resume: Flag = False,
    rate: float | None = None,
    dry_run: DryRun = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Bring what `scene export` wrote into a new scene: its spaces, what has moved them, and every record at its place.

    The whole file is checked first. The scene belongs to you, is in edit mode, and nobody else may use it until you say so. An import that was ended goes on with --resume; it writes only where nothing is.

    Example: scenectl scene import-archive kitchen.tar --scene pantry --profile studio

    Parameters
    ----------
    file
        The archive.
    scene
        Name of the new scene; by default that of the one that was archived.
    copies
        How many nodes shall hold each record, 1 to 8; by default as many as each space had.
    min_copies
        How many must hold a record before it counts as stored; with --copies only.
    resume
        Go on with an import of this archive that was ended, in the scene that it has begun.
    rate
        MiB that are stored in a second, at most; by default as fast as it goes.
    dry_run
        Check the file and say what is in it, and make nothing; no node is asked.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run
    from scenefold.base.errors import Refused, Unreachable
    from scenefold.client import RestoreOptions
    from scenefold.scene.archive import Archive

    name, speed = Archive(file).scene.name if scene is None else scene, bytes_per_s(rate)
    if dry_run:
        _look(name, file, output)
        return

    async def work(progress: Progress) -> RestoreReport:
        options = RestoreOptions(copies, min_copies, resume, progress, speed)
        async with connected(output.profile) as cluster:
            _, report = await cluster.scenes.import_archive(name, file, options)
            return report

    with Progress(quiet=output.json) as progress:
        try:
            report = run(work, progress)
        except Interrupted as ended:
            ended.remedy = GOES_ON
            raise
        except (Unreachable, Refused):
            note(f"what was stored stays; once the reason is gone, {GOES_ON}")
            raise
    text = f"{file} is in scene {name}: {report.records} records, {size_text(report.bytes)}, {report.seconds:.1f} s."
    text += "".join(f"\nspace {space} has the number {number} now" for space, number in report.renumbered.items())
    emit(output, {"scene": name, "file": str(file), "dry_run": False, **report.document()}, text)


def _look(name: str, file: Path, output: ProfileOutput) -> None:
    """Say what is in an archive that is whole."""
    from scenectl.progress import Progress
    from scenectl.running import run
    from scenefold.client import CheckedArchive, RestoreOptions, check_archive
    from scenefold.world import offline_world

    async def check(progress: Progress) -> CheckedArchive:
        return await check_archive(offline_world(), file, RestoreOptions(progress=progress))

    with Progress(quiet=output.json) as progress:
        checked = run(check, progress)
    archived, size = checked.archive.scene, checked.bytes
    spaces = [space.name for space in archived.spaces]
    text = f"{file} has scene {archived.name} with {len(spaces)} spaces: {checked.records} records, {size_text(size)}. It is whole."
    told = {"scene": name, "file": str(file), "dry_run": True, "records": checked.records, "bytes": size, "spaces": spaces}
    emit(output, told, text)
