"""`scenectl scene purge`, `scene strays`: deleted records go for good, and what comes back is looked at by who can read it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, size_text, table
from scenectl.values import SpaceOption, name_or_number
from scenefold.base.errors import UsageFault

if TYPE_CHECKING:
    from scenefold.client import Purge, SuspectReport

DryRun = Annotated[bool, Parameter(negative="", show_default=False)]
Flag = Annotated[bool, Parameter(negative="", show_default=False)]


def purge(
    scene: SceneName,
    /,
    *,
    space: SpaceOption | None = None,
    dry_run: DryRun = False,
    rate: float | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Let deleted records go for good, and with them the room that they take. A writer's to do; an owner's for what was deleted since the last purge.

    A deletion is a record, and stays until no node has anything older: a node that is away holds it up until it is back, or removed. May be interrupted at any time; what is gone is gone, and the same command goes on. Exit code 5 if something has to wait.

    Example: scenectl scene purge kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    space
        Name or number of the only space to look through.
    dry_run
        Look what could go, and change nothing.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run

    speed = bytes_per_s(rate)

    async def do(progress: Progress) -> Purge:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            spaces = () if space is None else ((await opened.space_named(name_or_number(space.text))).id,)
            return await opened.purge(spaces, dry_run=dry_run, progress=progress, bytes_per_s=speed)

    with Progress(quiet=output.json) as progress:
        report = run(do, progress)
    emit(output, {"scene": scene, **report.document()}, _purged(scene, report))
    return DONE if report.is_complete else DEGRADED


def _purged(scene: str, report: Purge) -> str:
    done = f"could go: {report.can_go}" if report.is_dry else f"gone: {report.purged}"
    lines = [f"{scene}: {report.deleted} deletions among {report.walked} records, {done}, {report.seconds:.1f} s."]
    if report.kept:
        lines.append(f"{report.kept} stay as long as records lie right behind them.")
    if report.overtaken:
        lines.append(f"At {report.overtaken} places somebody has written meanwhile.")
    if report.waiting:
        lines.append(f"{report.waiting} have to wait; the same command goes on:")
        lines += [f"  {reason}" for reason in report.reasons]
    if report.not_begun:
        lines.append(f"{report.not_begun} were deleted since the last purge began: let an owner of the scene call this.")
    return "\n".join(lines)


def strays(
    scene: SceneName,
    /,
    *,
    restore: Flag = False,
    discard: Flag = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Show what nodes keep apart of a scene, as they were away while deletions were purged: the last copy of something, or what was deleted.

    Nobody but who can read it knows which. Exit code 5 as long as something is kept apart, or a node did not answer.

    Example: scenectl scene strays kitchen --restore --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    restore
        Write those anew that nothing lies in the place of, and let all go.
    discard
        Let all go for good.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run

    if restore and discard:
        raise UsageFault("what is restored is not discarded", where="--restore --discard", remedy="give one of them")

    async def do(progress: Progress) -> SuspectReport:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await opened.strays(restore=restore, discard=discard, progress=progress)

    with Progress(quiet=output.json) as progress:
        report = run(do, progress)
    emit(output, {"scene": scene, **report.document()}, _kept_apart(scene, report))
    return DEGRADED if report.left or report.silent else DONE


def _kept_apart(scene: str, report: SuspectReport) -> str:
    lines = [f"{scene}: {report.records} records are kept apart." if report.records else f"Nothing of {scene} is kept apart."]
    if report.listed:
        rows = [
            (
                str(stray.space),
                (stray.object or stray.location).hex(),
                "?" if stray.size is None else size_text(stray.size),
                str(stray.epoch),
                "deletion" if stray.is_deletion else "replaced" if stray.is_replaced else "unreadable" if stray.size is None else "record",
                ", ".join(stray.kept_by),
            )
            for stray in report.listed
        ]
        lines.append(table(("space", "place or object", "size", "position", "what", "kept by"), rows))
    if len(report.listed) < report.records:
        lines.append(f"and {report.records - len(report.listed)} more")
    if report.restored or report.discarded:
        lines.append(f"{report.restored} were written anew, {report.discarded} are kept apart no more.")
    if report.silent:
        lines.append(f"No answer from {', '.join(report.silent)}: more may be kept there.")
    if report.left and not report.discarded:
        lines.append(f"`scenectl scene strays {scene} --restore` writes them anew, --discard lets them go.")
    return "\n".join(lines)
