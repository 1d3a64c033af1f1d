"""`scenectl scene rm`: a scene ends, and nodes let go of what it held."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note
from scenectl.repeating import RequestOption, one_change
from scenefold.base.errors import UsageFault
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client.ending import SceneEnd

Flag = Annotated[bool, Parameter(negative="", show_default=False)]


def rm(
    scene: SceneName,
    /,
    *,
    yes: Flag = False,
    dry_run: Flag = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """End a scene for ever: nothing of it is written or read any more, and all nodes drop what it held. Only owners can.

    Nobody brings it back: `scene export` first if it may be wanted again. Nodes drop the data, with all copies, once each node of the cluster knows of it; one that is away holds that up until it is back, or removed. The id is never used again, and the keys stay in the profile. Whoever edits is refused from then on, and a render that reads the scene fails. A scene that was ended stays so, and that is no error.

    Example: scenectl scene rm kitchen --yes --profile studio

    Parameters
    ----------
    scene
        Name of the scene in this profile.
    yes
        Do not ask; without it you are asked on a terminal to type the scene's name.
    dry_run
        Say how many records would go, and change nothing.
    """
    from scenectl.running import connected, run

    change = Change(request)

    async def do() -> SceneEnd:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).end(dry_run=dry_run, again=change)

    with one_change("scene rm", scene, change, is_none=dry_run):
        if not (yes or dry_run):
            _confirm(str(scene), output)
        found = run(do)
    emit(output, {"scene": scene, "dry_run": dry_run, **found.document()}, end_text(str(scene), found))


def end_text(name: str, found: SceneEnd) -> str:
    """What became of it, and of the data."""
    if found.position is None:
        return f"Scene {name} would end, and its {found.records} records would go from all nodes. Nothing was changed."
    if found.was_ended:
        return f"Scene {name} was ended before, at position {found.position} of its log."
    dropping = "Each node drops what it held, with all copies, once all nodes know of it; one that is away holds that up."
    return f"Scene {name} is ended, at position {found.position} of its log. {dropping} Its keys stay in this profile."


def _confirm(name: str, output: ProfileOutput) -> None:
    where = f"scenectl scene rm {name}"
    if output.json or sys.stdin is None or not sys.stdin.isatty():
        remedy = "say --yes if you mean it, or --dry-run to see what would go"
        raise UsageFault("a scene that is ended cannot be brought back", where=where, remedy=remedy)
    note(f"Scene {name} would end for ever, and all nodes would drop what it holds. Type its name to go on:")
    if sys.stdin.readline().strip() != name:
        raise UsageFault("that is not the scene's name", where=where, remedy="try again; nothing was changed")
