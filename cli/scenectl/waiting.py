"""What somebody can do about a node that is away when a command needs it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from scenectl.errors import UNREACHABLE, ending_of, most_telling
from scenefold.base.errors import ScenefoldError

ONCE_BACK = "once who is away is back, or has been removed, which takes two minutes of silence, "


@contextmanager
def going_on(what: str) -> Iterator[None]:
    """Around what may need a node that is away: the error then says, beside its own remedy, when `what` can be done."""
    try:
        yield
    except BaseException as error:
        problem = most_telling(error)
        if isinstance(problem, ScenefoldError) and ending_of(problem).exit_code == UNREACHABLE:
            problem.remedy = f"{problem.remedy}; {ONCE_BACK}{what}".removeprefix("; ")
        raise
