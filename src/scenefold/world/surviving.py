"""No packet ends a node: what goes wrong over one by a bug of ours is a line in the log, and the node goes on.

Only a disk that failed ends it, whoever met that: what it still takes is not known.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from scenefold.base.errors import LocalFault, ScenefoldError
from scenefold.world.ports import DiskFailed
from scenefold.world.quiet import QuietLog

BUG = LocalFault("the node failed over this request", remedy="its log says more")
"""What a peer hears of a bug: what an exception says may be nobody else's business."""


def ends_the_node(error: Exception) -> bool:
    """Whether no node may go on after this."""
    if isinstance(error, ExceptionGroup):
        return any(map(ends_the_node, error.exceptions))
    return isinstance(error, DiskFailed)


def say_bug(quiet: QuietLog, now: float, source: str, bug: Exception) -> None:
    """Tell of a bug over what this source has sent."""
    kind = type(bug).__name__
    quiet.say(now, source, kind, f"an internal error, {kind}, in answering it", bug)


@contextmanager
def surviving(quiet: QuietLog, now: float, source: str) -> Iterator[None]:
    """Around the handling of a datagram of this source: what fails within is told, and the datagram dropped."""
    try:
        yield
    except ScenefoldError as problem:
        quiet.say(now, source, type(problem).__name__, f"a datagram is dropped: {problem}")
    except Exception as bug:  # whatever it is: the one who sent this is no reason to be away for all others
        if ends_the_node(bug):
            raise
        say_bug(quiet, now, source, bug)
