"""Logs of simulated nodes: nobody reads their complaints, but a bug that a node survives is a violation."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from scenefold.world.quiet import BUGS


@contextmanager
def quiet_logs() -> Iterator[None]:
    """Nodes of a simulation complain of faults all the time, as they should. Who hears of bugs within hears no more after it."""
    ours = logging.getLogger("scenefold")
    before = ours.level, BUGS.level, BUGS.propagate, list(BUGS.handlers)
    ours.setLevel(logging.CRITICAL + 1)
    BUGS.setLevel(logging.ERROR)
    BUGS.propagate = False
    try:
        yield
    finally:
        ours.setLevel(before[0])
        BUGS.setLevel(before[1])
        BUGS.propagate = before[2]
        BUGS.handlers[:] = before[3]


def hear_bugs(tell: Callable[[str], None]) -> None:
    """Tell of each bug that a node survives, from now on."""
    BUGS.addHandler(_Teller(tell))


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str], None]) -> None:
        super().__init__(logging.ERROR)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        error = record.exc_info[1] if record.exc_info else None
        self._tell(f"{record.getMessage()}: {error}")
