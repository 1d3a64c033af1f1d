"""What an image of an archived scene is by default, in its JSON (specs/24-archive.md). Pure."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.scene.archive.told import Told
from scenefold.wire import RenderSettings
from scenefold.wire.errors import Misfit
from scenefold.wire.render_settings import RENDER_SETTINGS

WHERE = "'render'"


def settings_document(settings: RenderSettings) -> dict[str, Any]:
    """What the scene says; what it does not say is left out."""
    return {name: list(value) if name == "sky" else value for name, value in asdict(settings).items() if value is not None}


def read_settings(document: object) -> RenderSettings:
    """DamagedData for what no scene's log can say."""
    told = Told(document, WHERE)
    sky, exposure = told.get("sky", None), told.get("exposure", None)
    settings = RenderSettings(
        told.get("width", None),
        told.get("height", None),
        told.get("samples", None),
        told.get("depth", None),
        None if sky is None else told.floats("sky", 3),
        None if exposure is None else told.numbers([exposure], "exposure")[0],
        told.get("camera", None),
    )
    try:
        RENDER_SETTINGS.plain(settings)
    except Misfit as misfit:
        raise DamagedData(f"{WHERE}{misfit.path} is not what it must be: {misfit.problem}") from None
    return settings
