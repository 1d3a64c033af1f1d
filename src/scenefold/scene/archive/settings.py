"""What an image of an archived scene is by default, in its JSON (specs/24-archive.md). Pure."""

from __future__ import annotations

from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.scene.archive.told import Told
from scenefold.wire import RenderSettings
from scenefold.wire.errors import Misfit
from scenefold.wire.render_settings import RENDER_SETTINGS

WHERE = "'render'"
_REALS = frozenset({"exposure", "aperture", "focus", "clamp_direct", "clamp_indirect", "adaptive", "environment_rotation"})


def settings_document(settings: RenderSettings) -> dict[str, Any]:
    """What the scene says; what it does not say is left out."""
    return {name: list(value) if name == "sky" else value for name, value in settings.flat().items() if value is not None}


def read_settings(document: object) -> RenderSettings:
    """DamagedData for what no scene's log can say."""
    told = Told(document, WHERE)
    found = {name: told.get(name, None) for name in RenderSettings().flat()}
    said = {name: value for name, value in found.items() if value is not None}
    for name in _REALS & said.keys():
        (said[name],) = told.numbers([said[name]], name)
    if "sky" in said:
        said["sky"] = told.floats("sky", 3)
    settings = RenderSettings().changed(said)
    try:
        RENDER_SETTINGS.plain(settings)
    except Misfit as misfit:
        raise DamagedData(f"{WHERE}{misfit.path} is not what it must be: {misfit.problem}") from None
    return settings
