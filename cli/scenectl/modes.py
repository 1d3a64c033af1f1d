"""`scenectl scene mode`: which mode a scene is in, and changing it."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.errors import DONE, UNREACHABLE
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note
from scenectl.repeating import RequestOption, one_change, position_of
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client.modes import ModeShown


class Mode(Enum):
    """As people write it."""

    EDIT = "edit"
    RENDER = "render"


def mode(
    scene: SceneName,
    to: Annotated[Mode | None, Parameter(help="The mode that it shall be in; none is changed if this is left out.")] = None,
    /,
    *,
    force: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Tell which mode a scene is in, or switch it: in edit mode it can be changed; in render mode only the output of a render is written, and spaces stay as they are.

    A mode is active once nobody can act by the one before any more: at once, or, if one of those who decide cannot be reached, after some 13 s. Exit code 0: it is active. 3: it is decided, and not active yet, or no majority confirms it. 4: it was refused, or somebody else has switched it again meanwhile.

    Whoever takes part in the scene and seems alive is asked first, and may have something against it: a render that is under way, or an edit.

    Example: scenectl scene mode kitchen render --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    force
        Ask nobody: renders that are under way come to an end, and who does not answer is passed over. What somebody may still act by is waited for all the same, some 13 s at most.
    """
    from scenectl.running import connected, run
    from scenefold.client.modes import mode_of, set_mode
    from scenefold.wire import SceneMode

    change = Change(request)

    async def ask() -> ModeShown:
        async with connected(output.profile) as cluster:
            access = (await cluster.scenes.open(scene)).access
            if to is None:
                return await mode_of(access)
            return await set_mode(
                access,
                SceneMode[to.name],
                lambda position: note(f"decided: {to.value} mode, position {position} of the log"),
                lambda since: note(so_already_text(to.value, since)),
                force=force,
                again=change,
            )

    with one_change("scene mode", scene, change, is_none=to is None):
        found = run(ask)
    emit(output, {"scene": scene, **found.document(), **position_of(change)}, mode_text(found))
    return DONE if found.is_active else UNREACHABLE


def mode_text(found: ModeShown) -> str:
    """A sentence."""
    decided = f"At position {found.position} of its log the scene is in {found.mode.name.lower()} mode"
    if found.is_active:
        return f"{decided}, which is active."
    if found.is_active is None:
        why = "no participant that can be asked reaches most of the others"
        return f"{decided}, as far as those know who can be asked. No majority confirms it, and whether it is active is unknown: {why}."
    return f"{decided}, which is decided and not active yet: leases of before may still be used."


def so_already_text(mode: str, since: int | None) -> str:
    """Why nothing was decided."""
    return f"nothing to decide: the scene is in {mode} mode already" + ("" if since is None else f", since position {since} of the log")
