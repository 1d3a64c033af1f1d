"""What an image of a scene is by default, as its log says: for everybody who renders it (specs/16-scene-log.md, Folding)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scenefold.client.access import SceneAccess
from scenefold.client.contents import camera_names, check_camera
from scenefold.client.log_reading import ReadLog
from scenefold.client.requests import Again, request_in
from scenefold.wire import RenderSettings


@dataclass(frozen=True, slots=True)
class SettingsShown:
    """As of one position of the scene's log."""

    position: int
    settings: RenderSettings

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md): null where the scene does not say."""
        return {"position": self.position, **self.settings.flat(), "sky": None if self.settings.sky is None else list(self.settings.sky)}


async def settings_of(access: SceneAccess) -> SettingsShown:
    """What the newest log says."""
    return _shown(await access.read_log())


async def change_settings(access: SceneAccess, change: Callable[[RenderSettings], RenderSettings], *, again: Again = None) -> SettingsShown:
    """Have what the log says then changed; an owner's to do, in edit mode. Nothing is decided if that changes nothing.

    `change` may be called more than once: others may be faster. Refused (9) in render mode; LocalFault for what no image can be, and for a
    camera that the scene does not have, unless nothing was imported yet.
    """
    before, request = await access.read_log(), request_in(again)
    is_there = request is not None and request.id in before.state.requests
    if change(before.state.render) == before.state.render and not is_there:
        return _shown(before)
    camera = change(before.state.render).camera
    if camera is not None and camera != before.state.render.camera and not is_there:
        names = await camera_names(access)
        if names is not None:
            check_camera(camera, names)
    return _shown(await access.change_log(lambda log: change(log.render), again=again))


def _shown(log: ReadLog) -> SettingsShown:
    return SettingsShown(log.header.position, log.state.render)
