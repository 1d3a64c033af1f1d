"""What a command says: options that every verb has, results as text or as one JSON object, errors as one line.

Results go to standard output, everything else to standard error, so that `scenectl ... --json | jq` works
whatever happens. All of it, and what is logged, leaves here: names, refusals and reports are words of others, and a terminal obeys
whoever writes to it. The shapes of the JSON objects are listed in docs/reference/scenectl.md and are kept stable.
"""

from __future__ import annotations

import datetime
import logging
import os
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any, TextIO

from cyclopts import Group, Parameter

from scenectl.errors import READER_LEFT, STANDARD_OUTPUT, Ending
from scenefold.base.printable import printable, printable_json, printable_lines

GENERAL = Group("General options", sort_key=90)
ERROR_CHARACTERS_MAX = 4_000
CELL_CHARACTERS_MAX = 1_000


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


def counted(number: int, one: str, several: str = "") -> str:
    """`1 node`, `1,005 nodes`. `several`: where that is not `one` with an s."""
    return f"{number:,} {one if number == 1 else several or one + 's'}"


def emit(output: Output, document: Mapping[str, Any], text: str) -> None:
    """Print a result: the JSON object if asked for, else the text."""
    with writing_to(STANDARD_OUTPUT):
        if output.json:
            print(printable_json(document, indent=2))
        elif text:
            print(printable_lines(text))


def emit_event(output: Output, document: Mapping[str, Any], text: str) -> None:
    """Print what a verb that goes on running has to say, on one line and at once, for whoever reads its pipe."""
    with writing_to(STANDARD_OUTPUT):
        print(printable_json(document) if output.json else printable_lines(text), flush=True)


def note(text: str, stream: TextIO | None = None) -> None:
    """Print what is no result: on standard error, if not elsewhere."""
    with writing_to("standard error"):
        print(printable_lines(text), file=sys.stderr if stream is None else stream, flush=True)


def emit_error(ending: Ending, *, as_json: bool, error: BaseException | None = None) -> int:
    """Print how a command ended badly, with `error` also its traceback (--debug), and return the exit code: whatever a stream takes, this ends well."""
    try:
        if error is not None:
            note("".join(traceback.format_exception(error)).rstrip())
        note(f"error: {printable(ending.line, ERROR_CHARACTERS_MAX)}")
    except OSError:
        drop(sys.stderr)
    if sys.stdout is None:
        return ending.exit_code
    try:
        if as_json:
            print(printable_json(ending.document()))
        sys.stdout.flush()
    except OSError as problem:
        drop(sys.stdout)
        return READER_LEFT if isinstance(problem, BrokenPipeError) else ending.exit_code
    return ending.exit_code


@contextmanager
def writing_to(name: str) -> Iterator[None]:
    """Name the stream in an error of writing to it."""
    try:
        yield
    except OSError as problem:
        problem.filename = problem.filename or name
        raise


def drop(stream: TextIO) -> None:
    """Let what could not be written to a standard stream go: writing it out at exit would fail once more."""
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, stream.fileno())
    os.close(sink)


class PrintableFormatter(logging.Formatter):
    """Of what modules log: words of others are in it, too."""

    def format(self, record: logging.LogRecord) -> str:
        return printable_lines(super().format(record))


def plain_logs() -> None:
    """Let warnings, which come to standard error where no verb sets up anything else, steer no terminal. For the main program only."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(PrintableFormatter())


def table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Columns as wide as they need; numbers to the right, words to the left. What would steer a terminal is written out."""
    cells = [[printable(str(cell), CELL_CHARACTERS_MAX) for cell in row] for row in rows]
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


def and_text(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def date_text(seconds: float) -> str:
    """A moment, in seconds since 1970, for people; "?" for one that no calendar has."""
    try:
        return datetime.datetime.fromtimestamp(seconds, datetime.UTC).strftime("%Y-%m-%d %H:%M:%SZ")
    except (OverflowError, ValueError, OSError):
        return "?"


def time_text(seconds: float) -> str:
    """A time that something takes, for people: 12 s, 7 min, 2.5 h."""
    whole = max(1, round(seconds))
    return f"{whole} s" if whole < 100 else f"{whole // 60} min" if whole < 6000 else f"{whole / 3600:.1f} h"


def _is_number(cell: str) -> bool:
    return cell[:1].isdigit()
