"""What long calls report while they run: which phase, how much of it is done. Whoever calls decides how to show it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ProgressState:
    """`done` of `total` units (None: not known yet) of a phase such as "import"."""

    phase: str
    done: int
    total: int | None
    unit: str


ProgressCallback = Callable[[ProgressState], None]
"""Called on the Trio thread, often; must return at once."""


def no_progress(state: ProgressState) -> None:
    """For callers that want none."""
    del state
