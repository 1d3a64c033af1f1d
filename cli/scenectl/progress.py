"""Progress on standard error: bars where a person watches, plain lines at most once a second where not.

Verbs hand `Progress` itself to the client as its callback. The client reports as often as it likes; here it
is decided what is shown.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self, TextIO

from scenectl.output import note, time_text
from scenefold.base.printable import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bars
    from rich.progress import TaskID

    from scenefold.client import ProgressState

LINE_INTERVAL_S = 1.0
LEFT_AFTER_S = 2.0
"""A pace that was measured for less says nothing."""


class _Begun(NamedTuple):
    """Where a phase stood when it was first heard of."""

    at: float
    done: int


class Progress:
    """A context manager and a callback for `ProgressState`s; also times the phases it is told about."""

    def __init__(self, *, quiet: bool = False, stream: TextIO | None = None, now: Callable[[], float] = time.monotonic) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._quiet = quiet
        self._now = now
        self._bars: Bars | None = None
        self._tasks: dict[str, TaskID] = {}
        self._begun: dict[str, _Begun] = {}
        self._line_at = -LINE_INTERVAL_S
        self._line = ""
        self._phase = ""
        self._has_ended = False
        self._held = ""

    def __enter__(self) -> Self:
        if not self._quiet and self._stream.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
            from rich.progress import Progress as Bars

            self._bars = Bars(
                TextColumn("{task.description:<12}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.fields[unit]}", markup=False),
                TimeElapsedColumn(),
                TextColumn("{task.fields[left]}", markup=False),
                console=Console(file=self._stream),
            )
            self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bars is not None:
            self._bars.stop()
        self._print_held()

    def __call__(self, state: ProgressState) -> None:
        if self._quiet:
            return
        left = self._left(state)
        if self._bars is not None:
            self._show_bar(self._bars, state, left)
        else:
            self._print_line(state, left)

    def _left(self, state: ProgressState) -> str:
        """`12 s left`, by the word of who does it or else by the pace so far; nothing where that cannot be known."""
        now, seconds = self._now(), state.seconds_left
        begun = self._begun.setdefault(state.phase, _Begun(now, state.done))
        if state.total is None or state.done >= state.total:
            return ""
        if seconds is None:
            passed, did = now - begun.at, state.done - begun.done
            if passed < LEFT_AFTER_S or did <= 0:
                return ""
            seconds = passed / did * (state.total - state.done)
        return f"{time_text(seconds)} left"

    def _show_bar(self, bars: Bars, state: ProgressState, left: str) -> None:
        task = self._tasks.get(state.phase)
        if task is None:
            task = self._tasks[state.phase] = bars.add_task(printable(state.phase), total=state.total, unit="", left="")
        bars.update(task, completed=state.done, total=state.total, unit=printable(state.unit), left=left)

    def _print_line(self, state: ProgressState, left: str) -> None:
        """What says that all is done comes at once; who says so again and again is heard once a second, and for the last time at the end."""
        if state.phase != self._phase:
            self._print_held()
            self._phase, self._has_ended = state.phase, False
        self._held = ""
        finished = state.total is not None and state.done >= state.total
        now = self._now()
        line = f"{state.phase}: {state.done}" + (f" of {state.total}" if state.total is not None else "")
        line = f"{line} {state.unit}".rstrip()
        if line == self._line:
            return
        if now - self._line_at < LINE_INTERVAL_S and (self._has_ended or not finished):
            self._held = line if finished else ""
            return
        self._line, self._line_at, self._has_ended = line, now, finished
        note(f"{line}, {left}" if left else line, self._stream)

    def _print_held(self) -> None:
        if self._held:
            note(self._held, self._stream)
        self._held = ""
