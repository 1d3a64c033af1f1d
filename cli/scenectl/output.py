"""What a command says: options that every verb has, results as text or as one JSON object, errors as one line.

Results go to standard output, everything else to standard error, so that `scenectl ... --json | jq` works
whatever happens. The shapes of the JSON objects are listed in docs/reference/scenectl.md and are kept stable.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from cyclopts import Group, Parameter

from scenectl.errors import Ending

GENERAL = Group("General options", sort_key=90)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Output:
    """Options of every verb."""

    json: Annotated[bool, Parameter(negative="", show_default=False, group=GENERAL)] = False
    "Print the result as one JSON object."
    debug: Annotated[bool, Parameter(negative="", show_default=False, group=GENERAL)] = False
    "Show a traceback if something fails."


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ProfileOutput(Output):
    """Options of every verb that speaks to a cluster."""

    profile: Annotated[str | None, Parameter(name=("--profile", "-p"), env_var="SCENEFOLD_PROFILE", group=GENERAL)] = None
    "Cluster profile: a folder made by `cluster init`, or the name of one in the configuration folder."


PLAIN = Output()
DEFAULT_PROFILE = ProfileOutput()


def emit(output: Output, document: Mapping[str, Any], text: str) -> None:
    """Print a result: the JSON object if asked for, else the text."""
    if output.json:
        print(json.dumps(document, indent=2, ensure_ascii=False))
    elif text:
        print(text)


def emit_event(output: Output, document: Mapping[str, Any], text: str) -> None:
    """Print what a verb that goes on running has to say, on one line and at once, for whoever reads its pipe."""
    print(json.dumps(document, ensure_ascii=False) if output.json else text, flush=True)


def emit_error(ending: Ending, *, as_json: bool, error: BaseException | None = None) -> None:
    """Print how a command ended badly; with `error` also its traceback (--debug)."""
    if error is not None:
        traceback.print_exception(error)
    print(f"error: {ending.line}", file=sys.stderr)
    if as_json:
        print(json.dumps(ending.document(), ensure_ascii=False))


def table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Columns as wide as they need; numbers to the right, words to the left. What would steer a terminal is written out."""
    cells = [[_printable(str(cell)) for cell in row] for row in rows]
    numeric = [bool(cells) and all(_is_number(row[index]) for row in cells) for index in range(len(titles))]
    widths = [max(len(line[index]) for line in [list(titles), *cells]) for index in range(len(titles))]
    lines = [list(titles), *cells]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if right else cell.ljust(width) for cell, width, right in zip(line, widths, numeric, strict=True)
        ).rstrip()
        for line in lines
    )


def size_text(count: float) -> str:
    """Bytes for people: 1.5 MiB."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if abs(count) < 1024:
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    return f"{count:.1f} TiB"


def _is_number(cell: str) -> bool:
    return cell[:1].isdigit()


def _printable(text: str) -> str:
    """Names come from others, and a terminal obeys whoever writes to it."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in text)
