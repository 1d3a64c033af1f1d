"""`scenectl data split`, `data merge`, `space tidy`: records that lie in parts, and what is left of such."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, size_text
from scenectl.values import PlaceOption, SpaceOption, name_or_number, whole

if TYPE_CHECKING:
    from scenefold.client import SplitReport, Tidied

PARTS_MAX = 256
"""Of one record. A test holds it equal to scenefold.scene.payloads.splits, slow to import."""
Flag = Annotated[bool, Parameter(negative="", show_default=False)]


def split(
    space: SpaceOption,
    location: PlaceOption,
    /,
    *,
    scene: SceneOption,
    parts: Annotated[int, whole(2, PARTS_MAX)] = 2,
    by: Literal["triangles", "bytes"] | None = None,
    dry_run: Flag = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Break a record into parts that lie elsewhere in its space. It keeps its location, and reads as before: whatever links to it still finds it.

    If this is interrupted, the same command goes on with it, by any writer; `space tidy` removes what is left if nobody does.

    Example: scenectl data split geometry 0a --parts 4 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    location
        Up to 40 hexadecimal digits; missing ones are 0.
    scene
        Name of the scene.
    parts
        Into how many.
    by
        A geometry atom by its triangles, each part near the middle of its own; or by bytes, scattered. By default what the record is.
    dry_run
        Only say where the parts would lie.
    """
    from scenectl.running import connected, run
    from scenefold.scene.payloads.splits import Cut

    cut = None if by is None else Cut[by.upper()]

    async def work() -> SplitReport:
        async with connected(output.profile) as cluster:
            asked = await (await cluster.scenes.open(scene)).space_named(name_or_number(space.text))
            return await asked.split(location.first, parts, cut=cut, dry_run=dry_run)

    report = run(work)
    emit(output, {"scene": scene, **report.document()}, _split(report))


def merge(
    space: SpaceOption,
    location: PlaceOption,
    /,
    *,
    scene: SceneOption,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Put a split record together again, in its place; its parts go.

    Example: scenectl data merge geometry 0a --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    location
        Up to 40 hexadecimal digits; missing ones are 0.
    scene
        Name of the scene.
    """
    from scenectl.running import connected, run

    async def work() -> SplitReport:
        async with connected(output.profile) as cluster:
            asked = await (await cluster.scenes.open(scene)).space_named(name_or_number(space.text))
            return await asked.merge(location.first)

    report = run(work)
    size = size_text(report.bytes)
    merged = f"{report.location.hex()} is whole again: {size} of {len(report.parts)} parts."
    emit(output, {"scene": scene, **report.document()}, merged if report.changed else f"{report.location.hex()} is whole already.")


def tidy(
    space: SpaceOption,
    /,
    *,
    scene: SceneOption,
    orphans: Flag = False,
    dry_run: Flag = False,
    rate: float | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Remove parts of split records that nobody needs: of splittings and merges that were ended, and of records that were edited or deleted since.

    Reads all of the space. Whoever splits a record in this moment begins anew. May be interrupted; the same command goes on. Exit code 5 if something cannot be read.

    Example: scenectl space tidy geometry --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    scene
        Name of the scene.
    orphans
        Also parts whose record is not there at all: deleted and purged, or lost with a disk.
    dry_run
        Look what there is, and change nothing.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run

    speed = bytes_per_s(rate)

    async def do(progress: Progress) -> tuple[int, Tidied]:
        async with connected(output.profile) as cluster:
            asked = await (await cluster.scenes.open(scene)).space_named(name_or_number(space.text))
            return asked.id, await asked.tidy(orphans=orphans, dry_run=dry_run, progress=progress, bytes_per_s=speed)

    with Progress(quiet=output.json) as progress:
        number, report = run(do, progress)
    emit(output, {"scene": scene, "space": number, **report.document()}, _tidied(str(space), report))
    return DEGRADED if report.unclear or report.unreadable else DONE


def _split(report: SplitReport) -> str:
    by = "" if report.cut is None else f" by {report.cut.name.lower()}"
    what = "would be split" if report.is_dry else "is split" if report.changed else "is split already"
    lines = [f"{report.location.hex()}, {size_text(report.bytes)}, {what} into {len(report.parts)} parts{by}:"]
    return "\n".join([*lines, *(f"  {part.hex()}" for part in report.parts)])


def _tidied(space: str, report: Tidied) -> str:
    lines = [f"{space}: {report.in_use} parts in use among {report.records} records, {report.seconds:.1f} s."]
    gone = "would go" if report.is_dry else "are gone"
    if report.left_over:
        lines.append(f"{report.left_over} that nobody needs {gone}.")
    if report.pending:
        lines.append(f"{report.pending} of splittings that were not ended {gone}.")
    if report.orphaned:
        lines.append(f"{report.orphaned} whose record is not there at all: --orphans removes them.")
    if report.removed:
        lines.append(f"{report.removed} were removed.")
    if report.unclear or report.unreadable:
        lines.append(f"{report.unreadable} records cannot be read, and {report.unclear} parts stay for that:")
        lines += [f"  {line}" for line in report.complaints]
    return "\n".join(lines)
