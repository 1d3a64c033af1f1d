"""A scene is ended: nothing of it is written or read any more, and nodes let go of what it held (specs/16-scene-log.md, The end)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import SceneId
from scenefold.base.location import FIRST, LAST
from scenefold.base.reasons import RejectReason
from scenefold.client.ranging import entries
from scenefold.client.requests import Again, Change, change_of
from scenefold.wire import EndScene, SceneLogPublic, SceneMode

if TYPE_CHECKING:
    from scenefold.client.access import SceneAccess


@dataclass(frozen=True, slots=True)
class SceneEnd:
    """What became of it. `position`: of its last record; None: it goes on, and this says what would be lost."""

    scene: SceneId
    position: int | None
    was_ended: bool = False
    """Before this was asked for."""
    records: int | None = None
    """That lie in its spaces, deleted ones among them, each counted once however many copies there are; None: they were not counted."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "id": f"{self.scene:08x}",
            "ended": self.position is not None,
            "position": self.position,
            "was_ended": self.was_ended,
            "records": self.records,
        }


async def plan_end(access: SceneAccess) -> SceneEnd:
    """What ending the scene would let go. LocalFault if that is not for us to do; Refused if the scene cannot be ended now."""
    header = await _header(access)
    if header.mode is SceneMode.ENDED:
        return _ended(header, was_ended=True)
    await access.log_or_fault().owner()
    _check_mode(access, header)
    count = 0
    for space in header.spaces:
        if not space.parent:
            async for _ in entries(access.calls, access.identity.scene, space.space, FIRST, LAST, stale_ok=False):
                count += 1
    return SceneEnd(header.scene, None, records=count)


async def end_scene(access: SceneAccess, *, again: Again = None) -> SceneEnd:
    """End the scene, for ever; an owner's to do. A scene that was ended stays so.

    LocalFault if we are no owner; Refused (9) in render mode, (13) while a lease may still be used that somebody has borrowed to edit or
    render; Unreachable, with words, if nobody knows what became of it.
    """
    header, change = await _header(access), change_of(again)
    if header.mode is SceneMode.ENDED:
        # Nobody shows its log any more; the header of what participants have decided names the request.
        return _ended(header, was_ended=not _is_by(header, change))
    await access.log_or_fault().owner()
    _check_mode(access, header)
    try:
        header = (await access.change_log(lambda _: EndScene(), again=change)).header
    except (Refused, Unreachable, LocalFault):
        # Somebody else may have ended it meanwhile, or our own word have been taken and the answer lost.
        header = await _header(access)
        if header.mode is not SceneMode.ENDED:
            raise
        _is_by(header, change)
    return _ended(header)


def _is_by(header: SceneLogPublic, change: Change) -> bool:
    """Whether a scene was ended by this very change, which knows its position then."""
    if change.request is None or header.request != change.request.id:
        return False
    change.stands(change.request.id, header.position)
    return True


async def _header(access: SceneAccess) -> SceneLogPublic:
    header = await access.log_or_fault().header()
    if header is None:
        raise LocalFault("the cluster does not know this scene", where=f"scene {access.name}")
    return header


def _check_mode(access: SceneAccess, header: SceneLogPublic) -> None:
    if header.mode is SceneMode.RENDER:
        remedy = f"when no render runs any more, `scenectl scene mode {access.name} edit`"
        raise Refused(RejectReason.MODE_FORBIDS, "the scene is in render mode", where=f"scene {access.name}", remedy=remedy)


def _ended(header: SceneLogPublic, *, was_ended: bool = False) -> SceneEnd:
    return SceneEnd(header.scene, header.position, was_ended)
