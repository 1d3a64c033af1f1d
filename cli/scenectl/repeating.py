"""What all commands say that make one change of a scene's log: where it is in the log; or that nobody knows, and how to find out.

With `--request` a change of which nobody knows is repeated so that it happens once at most.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

from cyclopts import Parameter, Token

from scenectl.errors import Interrupted, most_telling
from scenectl.values import shown_default
from scenefold.base.errors import ScenefoldError, UsageFault
from scenefold.client.requests import Change, InDoubt, Request, how_to_find_out


def _repeated(_kind: Any, tokens: Sequence[Token]) -> Request:
    request = Request.parse(tokens[0].value)
    if not request.offered_at:
        raise ValueError(f"to repeat a change takes the position, too: {request}@POSITION, as the error names it")
    return request


_HELP = "Make the very change of which an error said that nobody knows, by the request that it named: it happens once at most."
RequestOption = Annotated[
    Request | None,
    Parameter(name="--request", converter=_repeated, n_tokens=1, accepts_keys=False, negative="", show_default=shown_default, help=_HELP),
]


@contextmanager
def one_change(verb: str, scene: str, change: Change, *, is_none: bool = False, tells_rest: bool = False) -> Iterator[None]:
    """Around the one change that a verb makes, and is told of: however it ends, what became of the change is said, or how to find out.

    `is_none`: by its other options the verb changes nothing; UsageFault then if a request is given. `tells_rest`: of what fails behind the change the
    verb says itself what is left to do.
    """
    if is_none and change.request is not None:
        remedy = "leave --request out, or give what the change was made with"
        raise UsageFault("a request is that of a change, and nothing is to be changed", where=f"scenectl {verb}", remedy=remedy)
    try:
        yield
    except BaseException as error:
        problem = most_telling(error)
        if isinstance(problem, KeyboardInterrupt) and change.request is not None:
            struck = Interrupted()
            _tell_interrupted(struck, scene, change)
            raise struck from error
        if isinstance(problem, Interrupted):
            _tell_interrupted(problem, scene, change)
        elif isinstance(problem, InDoubt):
            problem.remedy += _or_repeat(problem.request)
        elif isinstance(problem, ScenefoldError) and change.position is not None and not tells_rest:
            problem.what = (
                f"the change is made, at position {change.position} of the scene's log; what comes after it failed: {problem.what}"
            )
        raise


def _tell_interrupted(problem: Interrupted, scene: str, change: Change) -> None:
    """Whoever gives the same command again would make a second change."""
    if change.position is not None:
        problem.what = f"interrupted; the change is made, at position {change.position} of the scene's log"
        problem.where, problem.remedy = f"scene {scene}", "what comes after it was left; the change need not be made again"
    elif change.request is not None:
        problem.what, problem.where = "interrupted: it is not known whether the change was made", f"scene {scene}"
        problem.remedy = how_to_find_out(scene, change.request) + _or_repeat(change.request)
        problem.request = str(change.request)


def _or_repeat(request: Request) -> str:
    return f"; or repeat the very same command with `--request {request}`: then it happens once at most"


def position_of(change: Change) -> dict[str, int]:
    """For the JSON form: where the change is in the log, in place of the newest position; nothing if nothing was to be decided."""
    return {} if change.position is None else {"position": change.position}


def decided_text(change: Change) -> str:
    """A line behind what became of it; empty if nothing was to be decided."""
    return "" if change.position is None else f"\nDecided at position {change.position} of the scene's log."
