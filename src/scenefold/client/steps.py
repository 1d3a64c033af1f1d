"""What a space may be moved and scaled by, and which space: checked before an entry of the scene's log is made of it. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scenefold.base.arguments import as_float, as_floats
from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.scene.layout import SPACE_NAMES
from scenefold.scene.log import SceneLog


def movable(log: SceneLog, space: SpaceId) -> SpaceId:
    """The id of a space that may be translated and scaled; LocalFault for one that every scene has."""
    if space in SPACE_NAMES:
        what = f"the space {SPACE_NAMES[space]} holds imported content, which renderers take as it lies"
        raise LocalFault(
            what, where=f"space {space}", remedy="move the objects in the file and import it again, or make a space of your own"
        )
    return log.space(space).id


def checked_offset(offset: Sequence[float], space: SpaceId) -> tuple[float, ...]:
    """What a space is to be moved by; LocalFault if it is not finite."""
    try:
        by = as_floats(offset)
    except ValueError as problem:
        raise _no_offset(space, f": {problem}") from problem
    if not all(map(math.isfinite, by)):
        raise _no_offset(space)
    return by


def _no_offset(space: SpaceId, why: str = "") -> LocalFault:
    return LocalFault(f"a space is moved by finite numbers{why}", where=f"space {space}", remedy="give one for each dimension")


def checked_factor(factor: float, space: SpaceId) -> float:
    """What a space is to be scaled by; LocalFault if it is not finite and above 0."""
    try:
        by = as_float(factor)
    except ValueError as problem:
        raise _no_factor(space, f": {problem}") from problem
    if not (math.isfinite(by) and by > 0.0):
        raise _no_factor(space, f", not {by:g}")
    return by


def _no_factor(space: SpaceId, why: str) -> LocalFault:
    return LocalFault(f"a space is scaled by a finite factor above 0{why}", where=f"space {space}", remedy="0.5 halves it, 2 doubles it")
