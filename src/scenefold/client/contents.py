"""What a scene shows, as far as it is asked for by name: its document, and its cameras (specs/05-scene-content.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.client.access import SceneAccess
from scenefold.client.space import Space
from scenefold.scene.layout import CAMERAS, DOCUMENT_LOCATION, META

if TYPE_CHECKING:
    from scenefold.scene.payloads.document import SceneDocument

CAMERAS_SHOWN = 10


async def content_of(access: SceneAccess) -> SceneDocument | None:
    """The scene document, from which all tables are found; None if no import was completed yet."""
    from scenefold.scene.payloads.document import decode_document

    payload = await Space(access, META).get(DOCUMENT_LOCATION)
    return None if payload is None else decode_document(payload)


async def camera_names(access: SceneAccess) -> list[str] | None:
    """Those of the scene's cameras, of which there is always one; None if nothing was imported yet. DamagedData if a page is not there."""
    from scenefold.scene.payloads.cameras import decode_cameras

    content = await content_of(access)
    if content is None:
        return None
    names: list[str] = []
    for page in await Space(access, CAMERAS).get_many(content.pages["cameras"]):
        if page is None:
            raise DamagedData("a page of the scene's cameras is not there", where=f"scene {access.name}", remedy="import the file again")
        names += [camera.name for camera in decode_cameras(page)[1]]
    return names


def check_camera(name: str, names: Sequence[str]) -> None:
    """LocalFault if that is none of the scene's cameras."""
    if name not in names:
        known = ", ".join(map(repr, names[:CAMERAS_SHOWN])) + (" and others" if len(names) > CAMERAS_SHOWN else "")
        raise LocalFault(f"the scene has no camera {name!r}", where="camera", remedy=f"choose one of: {known}")
