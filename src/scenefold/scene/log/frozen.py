"""What nobody adds to a log while its scene is rendered: whatever changes what is read for an image (specs/26-modes.md, Who). Pure.

Logs of former versions hold spaces that were made or moved in render mode, and are folded as ever; who adds to one does not. Nor does he leave
a mode and come back to it in one record: of a record who decides sees the mode behind it alone, so nobody would be asked, nor wait.
"""

from __future__ import annotations

from collections.abc import Mapping

from scenefold.base.errors import Refused
from scenefold.base.ids import SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.scene.log.space import LoggedSpace
from scenefold.wire import Batch, CreateSpace, EndScene, LogEntry, ScaleSpace, SceneMode, SetCopies, SetMode, TranslateSpace


def frozen(what: str) -> Refused:
    """The refusal of something that edit mode alone allows."""
    remedy = "switch the scene back to edit mode first, when no render runs any more"
    return Refused(RejectReason.MODE_FORBIDS, what, where="scene log", remedy=remedy)


def check_mode(mode: SceneMode, spaces: Mapping[SpaceId, LoggedSpace], entry: LogEntry) -> SceneMode:
    """Refused (9) if an entry makes or changes a space in render mode, other than those for the output of renders; (5) if it is a batch that
    changes the mode more than once. Gives the mode behind it.

    `spaces`: those of the log before it.
    """
    match entry:
        case Batch(entries):
            if sum(isinstance(one, SetMode | EndScene) for one in entries) > 1:
                what, remedy = (
                    "one record sets the scene's mode once at most",
                    "set it, and wait until that mode is active, before what needs it",
                )
                raise Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)
            for one in entries:
                mode = check_mode(mode, spaces, one)
            return mode
        case SetMode():
            return entry.mode
        case CreateSpace():
            # A shadow changes where the records of its parent lie. A parent that is made in this very batch was looked at.
            of_output = entry.parent not in spaces or spaces[entry.parent].render_output
            is_output, what = entry.render_output and of_output, "no space is made"
        case TranslateSpace() | ScaleSpace() | SetCopies():
            # One that is not there was made in this very batch, or does not fit, and others say so.
            is_output, what = entry.space not in spaces or spaces[entry.space].render_output, "no space is changed"
        case _:
            return mode
    if mode is SceneMode.RENDER and not is_output:
        raise frozen(f"the scene is in render mode: {what} but for the output of renders")
    return mode
