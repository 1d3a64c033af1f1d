"""`scenectl node verify` and `node repair`: a node's folder looked at as a whole, and mended, while the node does not run."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE
from scenectl.output import PLAIN, Output, emit, size_text

if TYPE_CHECKING:
    from scenectl.progress import Progress
    from scenefold.peer.checking import Checked
    from scenefold.store.checking import Finding, Tell

SHOWN_MAX = 40
"""Findings that people are shown; programs get a thousand."""

Flag = Annotated[bool, Parameter(negative="", show_default=False)]


def verify(folder: Path, /, *, signatures: bool = True, output: Output = PLAIN) -> int:
    """Read all that a node has stored, and say what has been damaged, where, and what helps. Changes nothing.

    The node must not run. Exit code 5 if anything is damaged.

    Example: scenectl node verify /srv/scenefold

    Parameters
    ----------
    folder
        The node's data folder.
    signatures
        Whether the signatures of records are looked at, too; without them it takes a fifth of the time.
    """
    from scenectl.progress import Progress
    from scenefold.peer.checking import check_folder

    with Progress(quiet=output.json) as progress:
        checked = check_folder(folder, signatures=signatures, tell=_telling(progress))
    emit(output, _document(folder, checked), "\n".join(_told(folder, checked)))
    return DONE if checked.findings.is_sound else DEGRADED


def repair(folder: Path, /, *, dry_run: Flag = False, signatures: bool = True, output: Output = PLAIN) -> int:
    """Make anew what follows from something else that a node has stored. Sound records are never touched.

    What has rotted stays where it is until the node runs, which gets it from other nodes. If anything is damaged that nobody else has, nothing is changed. The node must not run. Exit code 5 if anything is left that is damaged.

    Example: scenectl node repair /srv/scenefold

    Parameters
    ----------
    folder
        The node's data folder.
    dry_run
        Only say what would be done.
    signatures
        Whether the signatures of records are looked at, too.
    """
    from scenectl.progress import Progress
    from scenefold.peer.checking import mend_folder

    with Progress(quiet=output.json) as progress:
        repaired = mend_folder(folder, dry_run=dry_run, signatures=signatures, tell=_telling(progress))
    after = repaired.after
    document = {
        "folder": str(folder),
        "dry_run": dry_run,
        "mended": len(repaired.done),
        "done": [_finding(finding) for finding in repaired.done[:1_000]],
        "after": _document(folder, after),
    }
    did = "would be mended" if dry_run else "mended"
    lines = [f"{len(repaired.done)} {did}.", *_lines(repaired.done)]
    # A dry run leaves all as it was, and what keeps it from mending is worth as much as what it would mend.
    lines += _told(folder, after)
    emit(output, document, "\n".join(lines))
    return DONE if after.findings.is_sound else DEGRADED


def _telling(progress: Progress) -> Tell:
    from scenefold.client import ProgressState

    return lambda phase, done, total: progress(ProgressState(phase, done, total, ""))


def _told(folder: Path, checked: Checked) -> list[str]:
    return [_summary(checked), *_lines(checked.findings.listed), *_advice(folder, checked)]


def _summary(checked: Checked) -> str:
    from scenefold.base.ids import address_of

    identity, found = checked.identity, checked.findings
    whose = "The folder of a node that cannot be told" if identity is None else f"Node {address_of(identity.node)}"
    looked = f"{found.signatures} signatures looked at"
    return f"{whose}: {found.records.records} records, {size_text(found.records.bytes)}, {looked}; {found.counts.total() or 'nothing'} damaged."


def _lines(findings: Iterable[Finding]) -> list[str]:
    listed = list(findings)
    lines = [f"  {', '.join(filter(None, (finding.table, finding.where)))}: {finding.what}" for finding in listed[:SHOWN_MAX]]
    return [*lines, f"  and {len(listed) - SHOWN_MAX} more"] if len(listed) > SHOWN_MAX else lines


def _advice(folder: Path, checked: Checked) -> list[str]:
    from scenefold.store.checking import Helps
    from scenefold.store.sealing import WIPE

    counts, lines = checked.findings.counts, []
    if counts[Helps.WIPE]:
        lines.append(f"{counts[Helps.WIPE]} cannot be mended: {WIPE}.")
    if counts[Helps.MEND] and counts[Helps.WIPE]:
        lines.append(f"{counts[Helps.MEND]} could be made anew, but for that: nothing is changed where something has to be wiped.")
    elif counts[Helps.MEND]:
        lines.append(f"{counts[Helps.MEND]} can be made anew: scenectl node repair {folder}")
    if counts[Helps.FETCH]:
        lines.append(f"{counts[Helps.FETCH]} the node gets from other nodes once it runs, if they have it.")
    return lines


def _document(folder: Path, checked: Checked) -> dict[str, Any]:
    from scenefold.base.ids import address_of
    from scenefold.store.checking import Helps

    identity, found = checked.identity, checked.findings
    return {
        "folder": str(folder),
        "node": None if identity is None else address_of(identity.node),
        "incarnation": None if identity is None else identity.incarnation.hex(),
        "boot": None if identity is None else identity.boot,
        "sound": found.is_sound,
        "records": found.records.records,
        "bytes": found.records.bytes,
        "signatures": found.signatures,
        **{str(helps): found.counts[helps] for helps in Helps},
        "findings": [_finding(finding) for finding in found.listed],
        "left_out": found.left_out,
    }


def _finding(finding: Finding) -> dict[str, str]:
    return {"table": finding.table, "where": finding.where, "what": finding.what, "helps": str(finding.helps)}
