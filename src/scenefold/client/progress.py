"""What long calls report while they run: which phase, how much of it is done. Whoever calls decides how to show it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ProgressState:
    """`done` of `total` units (None: not known yet) of a phase such as "import". `seconds_left`: as whoever does it knows; None: by the pace so far."""

    phase: str
    done: int
    total: int | None
    unit: str
    seconds_left: float | None = None


_log = logging.getLogger("scenefold.client")

ProgressCallback = Callable[[ProgressState], None]
"""Called on the Trio thread, often; must return at once."""


def no_progress(state: ProgressState) -> None:
    """For callers that want none."""
    del state


def log_progress(state: ProgressState) -> None:
    """For callers that only want to see that something happens: each phase's beginning and end, in the log."""
    if state.done in (0, state.total):
        _log.info("%s: %d of %s %s", state.phase, state.done, "?" if state.total is None else state.total, state.unit)


def callback_of(progress: ProgressCallback | bool) -> ProgressCallback:
    """True logs, False is silent, a function is called."""
    if isinstance(progress, bool):
        return log_progress if progress else no_progress
    return progress
