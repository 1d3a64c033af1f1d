"""`scenectl render report`: renders side by side, by the reports that they have left, or by their names in the cluster."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, size_text, table

if TYPE_CHECKING:
    from scenefold.render.comparing import Compared

REPORT_BYTES_MAX = 64 << 20
REPORTS_MAX = 64
NAME_CHARACTERS_MAX = 16
HASH_SHOWN = 12


def report(
    renders: Annotated[tuple[str, ...], Parameter(name="render", negative="")] = (),
    /,
    *,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Put renders side by side: time, processor time, memory, bytes moved, efficiency, moves of cells, transfers, the tail.

    Example: scenectl render report spatial.json visual.json

    Example: scenectl render report 3f9a --profile studio

    Parameters
    ----------
    renders
        Files that `render still --report` or `--json` have written; or names of renders in the cluster whose images were not fetched yet, as `scenectl render list` shows them.
    """
    from scenefold.base.errors import UsageFault
    from scenefold.render.comparing import compared

    where = "scenectl render report"
    if not 1 <= len(renders) <= REPORTS_MAX:
        what = f"{len(renders)} reports are named"
        raise UsageFault(what, where=where, remedy=f"name from 1 to {REPORTS_MAX} files, or renders of the cluster")
    names = [render for render in renders if _is_name(render)]
    asked = _asked(names, output.profile) if names else {}
    runs = [compared(asked[render] if render in asked else read_report(Path(render)), render) for render in renders]
    hashes = {run.image_sha256 for run in runs}
    document = {"renders": [run.document() for run in runs], "same_image": len(hashes) == 1 and None not in hashes}
    emit(output, document, comparison_text(runs))


def keep_report(path: Path | None, document: dict[str, Any]) -> None:
    """Write a report where it is wanted, if it is, whole or not at all; LocalFault if that fails. It is to be printed before."""
    from scenefold.render.image_files import write_atomically

    if path is None:
        return
    # Names of files need not be text: what is not ASCII is written out.
    data = (json.dumps(document, indent=2) + "\n").encode("ascii")
    write_atomically(path, lambda temporary: temporary.write_bytes(data), "the report")


def read_report(path: Path) -> Any:
    """What a file says; LocalFault if it cannot be read, or is no JSON."""
    from scenefold.base.errors import LocalFault

    try:
        with path.open("rb") as file:
            data = file.read(REPORT_BYTES_MAX + 1)
    except OSError as error:
        remedy = "name a file, or a render as `scenectl render list --profile P` shows it"
        raise LocalFault(f"cannot read the report: {error.strerror}", where=str(path), remedy=remedy) from error
    if len(data) > REPORT_BYTES_MAX:
        raise LocalFault("far too large for a report", where=str(path), remedy="check the path")
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        what = "that is no JSON, and so no report of a render"
        raise LocalFault(what, where=str(path), remedy="give what `scenectl render still --report FILE` has written") from error


def comparison_text(runs: Sequence[Compared]) -> str:
    """A column for each render, a line for each figure that any of them has."""
    lines: list[tuple[str, ...]] = []
    for label, cell in FIGURES:
        cells = [cell(run) for run in runs]
        if any(one is not None for one in cells):
            lines.append((label, *("-" if one is None else one for one in cells)))
    return table(("", *(run.report for run in runs)), lines)


FIGURES: tuple[tuple[str, Callable[[Compared], str | None]], ...] = (
    ("partition", lambda run: run.partition),
    ("scene", lambda run: run.scene),
    ("nodes", lambda run: f"{run.nodes:,}"),
    ("seconds", lambda run: f"{run.seconds:,.2f}"),
    ("processor seconds", lambda run: _real(run.processor_seconds, 2)),
    ("memory of a node, at most", lambda run: _size(run.memory_most)),
    ("read of the scene", lambda run: _size(run.bytes_read)),
    ("rays passed between nodes", lambda run: size_text(run.bytes_passed)),
    ("returned by tasks", lambda run: _size(run.bytes_returned)),
    ("paths", lambda run: f"{run.paths:,}"),
    ("transfers per path", lambda run: f"{run.transfers_per_path:.3f}"),
    ("bytes per path", lambda run: f"{run.bytes_per_path:.1f}"),
    ("efficiency", lambda run: f"{run.efficiency:.3f}"),
    ("efficiency by rounds", lambda run: _real(run.efficiency_of_rounds, 3)),
    ("rounds", lambda run: None if run.rounds is None else f"{run.rounds:,}"),
    ("moves of cells", lambda run: None if run.cells_moved is None else f"{run.cells_moved:,}"),
    ("seconds to 95 %", lambda run: _real(run.seconds_to_95, 2)),
    ("seconds to 100 %", lambda run: _real(run.seconds_to_100, 2)),
    ("tail, 100 % over 95 %", lambda run: _real(run.tail, 3)),
    ("image sha256", lambda run: None if run.image_sha256 is None else run.image_sha256[:HASH_SHOWN]),
)


def _real(value: float | None, digits: int) -> str | None:
    return None if value is None else f"{value:,.{digits}f}"


def _size(value: int | None) -> str | None:
    return None if value is None else size_text(value)


def _is_name(render: str) -> bool:
    """Whether that can be a render's name, and no file is called so."""
    is_hex = 0 < len(render) <= NAME_CHARACTERS_MAX and all(letter in "0123456789abcdefABCDEF" for letter in render)
    return is_hex and not Path(render).exists()


def _asked(names: Sequence[str], profile: str | None) -> dict[str, dict[str, Any]]:
    """The reports of renders in the cluster."""
    from scenectl.running import connected, run

    async def ask() -> dict[str, dict[str, Any]]:
        from scenefold.render.unattended import find_render, report_of_render

        found: dict[str, dict[str, Any]] = {}
        async with connected(profile) as cluster:
            for name in names:
                known = await find_render(cluster, name)
                found[name] = {"scene": known.scene, **await report_of_render(cluster, known)}
        return found

    return run(ask)
