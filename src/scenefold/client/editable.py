"""Which spaces take records that say in another way what they said before: split, merged, or carried on (specs/18-data.md, 16-scene-log.md)."""

from __future__ import annotations

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.copies import check_no_shadow
from scenefold.client.log_reading import ReadLog
from scenefold.client.wishes import Wish
from scenefold.scene.log import LoggedSpace
from scenefold.wire import SceneMode


def fixed_space(access: SceneAccess, log: ReadLog, space: SpaceId, what: str) -> LoggedSpace:
    """The space, if its records may be rewritten so; LocalFault else. `what`: what is to be done, for an error."""
    found = log.state.space(space)
    check_no_shadow(access.identity.layouts, space, what)
    where = f"space {space}"
    if found.node_managed:
        remedy = "what is split or carried on lies where its writer put it"
        raise LocalFault("the nodes choose where records of this space lie", where=where, remedy=remedy)
    if found.render_output:
        remedy = "only of other spaces can nodes tell that the scene is being rendered"
        raise LocalFault("renders write to this space", where=where, remedy=remedy)
    return found


async def editable(access: SceneAccess, space: SpaceId, what: str) -> tuple[ReadLog, LoggedSpace]:
    """The newest log, and the space in it. LocalFault also if we are no writer, Refused if the scene is in render mode: before anything is sent."""
    log = await access.read_log()
    found = fixed_space(access, log, space, what)
    await access.check([Wish(space, FIRST, b"")])
    if log.header.mode is SceneMode.RENDER:
        remedy = "switch it back to edit mode first"
        raise Refused(RejectReason.MODE_FORBIDS, "the scene is in render mode", where=f"scene {access.name}", remedy=remedy)
    return log, found
