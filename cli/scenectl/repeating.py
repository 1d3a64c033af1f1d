"""`--request`, of all commands that make one change of a scene's log: a change of which nobody knows is repeated so that it happens once at most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

from cyclopts import Parameter, Token

from scenectl.errors import most_telling
from scenectl.values import shown_default
from scenefold.base.errors import UsageFault
from scenefold.client.requests import InDoubt, Request


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
def one_change(verb: str, request: Request | None, *, is_none: bool = False) -> Iterator[None]:
    """Around the one change that a verb makes: if nobody knows what became of it, the error says how to repeat it.

    `is_none`: by its other options the verb changes nothing; UsageFault then if a request is given.
    """
    if is_none and request is not None:
        remedy = "leave --request out, or give what the change was made with"
        raise UsageFault("a request is that of a change, and nothing is to be changed", where=f"scenectl {verb}", remedy=remedy)
    try:
        yield
    except BaseException as error:
        problem = most_telling(error)
        if isinstance(problem, InDoubt):
            problem.remedy += f"; or repeat the very same command with `--request {problem.request}`: then it happens once at most"
        raise
