"""Progress on standard error: bars where a person watches, plain lines at most once a second where not.

Verbs hand `Progress` itself to the client as its callback. The client reports as often as it likes; here it
is decided what is shown.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Self, TextIO

from scenectl.output import note
from scenefold.base.printable import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bars
    from rich.progress import TaskID

    from scenefold.client import ProgressState

LINE_INTERVAL_S = 1.0


class Progress:
    """A context manager and a callback for `ProgressState`s; also times the phases it is told about."""

    def __init__(self, *, quiet: bool = False, stream: TextIO | None = None, now: Callable[[], float] = time.monotonic) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._quiet = quiet
        self._now = now
        self._bars: Bars | None = None
        self._tasks: dict[str, TaskID] = {}
        self._line_at = -LINE_INTERVAL_S
        self._line = ""

    def __enter__(self) -> Self:
        if not self._quiet and self._stream.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
            from rich.progress import Progress as Bars

            self._bars = Bars(
                TextColumn("{task.description:<12}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[unit]}", markup=False),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                console=Console(file=self._stream),
            )
            self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bars is not None:
            self._bars.stop()

    def __call__(self, state: ProgressState) -> None:
        if self._bars is not None:
            self._show_bar(self._bars, state)
        elif not self._quiet:
            self._print_line(state)

    def _show_bar(self, bars: Bars, state: ProgressState) -> None:
        task = self._tasks.get(state.phase)
        if task is None:
            task = self._tasks[state.phase] = bars.add_task(printable(state.phase), total=state.total, unit="")
        bars.update(task, completed=state.done, total=state.total, unit=printable(state.unit))

    def _print_line(self, state: ProgressState) -> None:
        finished = state.total is not None and state.done >= state.total
        now = self._now()
        line = f"{state.phase}: {state.done}" + (f" of {state.total}" if state.total is not None else "")
        line = f"{line} {state.unit}".rstrip()
        if line == self._line or (now - self._line_at < LINE_INTERVAL_S and not finished):
            return
        self._line, self._line_at = line, now
        note(line, self._stream)
