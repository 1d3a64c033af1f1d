"""`scenectl scene status`: what became of a change that nobody answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from scenectl.errors import DONE, REFUSED, UNREACHABLE, most_telling
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit
from scenectl.values import ONE_WORD
from scenefold.base.errors import Refused, Unreachable
from scenefold.client.requests import Request

if TYPE_CHECKING:
    from scenefold.client import Standing

RequestArgument = Annotated[Request, ONE_WORD]


def status(scene: SceneName, request: RequestArgument, /, *, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Tell what became of a change of which an error said that nobody knows. Any member of the scene may ask.

    Exit code 0: it is in the log. 4: it is not, and never will be. 3: that is not known yet, as nothing of it was begun, as far as is known, or nobody can tell now: ask again.

    Example: scenectl scene status kitchen 4f0c…c2@17 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    request
        The request, as the error names it.
    """
    from scenectl.running import connected, run

    async def ask() -> Standing:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).standing(request.id, request.offered_at)

    try:
        found = run(ask)
    except BaseException as error:
        problem = most_telling(error)
        if isinstance(problem, Refused):
            # Whoever reads the exit code would take it for an answer about the request.
            what = f"what became of the change was not told: {problem.what}"
            raise Unreachable(what, where=problem.where, remedy=problem.remedy) from error
        raise
    emit(output, {"scene": scene, "request": str(request), **found.document()}, standing_text(found))
    return DONE if found.position is not None else REFUSED if found.is_over else UNREACHABLE


def standing_text(found: Standing) -> str:
    """A sentence, with what can be done."""
    if found.position is not None:
        return f"It is in the scene's log, at position {found.position}."
    if found.is_over:
        return f"It is not in the scene's log, which is at position {found.known}, and never will be. Nothing was changed by it; it can be repeated."
    return (
        f"It is not in the scene's log, which is at position {found.known}, and those who decide know of nothing begun behind that. "
        f"It may still come, until something else is decided at position {found.known + 1}. Repeat the same command, with --request and this very request if it takes that: it happens once at most; the others go on by themselves where they were ended."
    )
