"""`scenectl space rebase`: coordinates inside of records, written anew as they are now."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import SpaceOption, name_or_number

if TYPE_CHECKING:
    from scenefold.client import Rebased

Flag = Annotated[bool, Parameter(negative="", show_default=False)]


def rebase(
    space: SpaceOption,
    /,
    *,
    holds: Literal["atoms", "float32", "float64"],
    scene: SceneOption,
    dry_run: Flag = False,
    rate: float | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Write records anew whose coordinates are from before the space was moved or scaled, as they are now. In edit mode only.

    Nobody has to: whoever reads a record knows when it was written, and can carry it on. Each time it is written, numbers are rounded to what the record holds. May be interrupted; the same command goes on. Exit code 5 if something was not understood, or cannot be read.

    Example: scenectl space rebase particles --holds float32 --scene kitchen --profile studio

    Parameters
    ----------
    space
        Name or number of the space.
    holds
        What its records are: geometry atoms, or nothing but rows of little-endian floats, one for each dimension.
    scene
        Name of the scene.
    dry_run
        Look how many there are, and change nothing.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    """
    from scenectl.progress import Progress
    from scenectl.rates import bytes_per_s
    from scenectl.running import connected, run
    from scenefold.scene.payloads.carrying import carrier

    speed = bytes_per_s(rate)

    async def do(progress: Progress) -> tuple[int, Rebased]:
        async with connected(output.profile) as cluster:
            asked = await (await cluster.scenes.open(scene)).space_named(name_or_number(space.text))
            return asked.id, await asked.rebase(carrier(holds), dry_run=dry_run, progress=progress, bytes_per_s=speed)

    with Progress(quiet=output.json) as progress:
        number, report = run(do, progress)
    emit(output, {"scene": scene, "space": number, **report.document()}, _rebased(str(space), report))
    return DEGRADED if report.unknown or report.unreadable or report.overtaken else DONE


def _rebased(space: str, report: Rebased) -> str:
    done = f"{report.behind - report.unknown} would be written anew" if report.is_dry else f"{report.rebased} were written anew"
    lines = [f"{space}: {report.behind} of {report.records} records are from before a step, {done}, {report.seconds:.1f} s."]
    if report.unknown:
        lines.append(f"{report.unknown} are of another kind than was said, or would lie too far off, and stay as they are.")
    if report.overtaken:
        lines.append(f"{report.overtaken} were written by somebody else all the time: do it again.")
    if report.unreadable:
        lines.append(f"{report.unreadable} cannot be read:")
        lines += [f"  {line}" for line in report.complaints]
    return "\n".join(lines)
