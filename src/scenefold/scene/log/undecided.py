"""The error of a header that nobody shows to have been decided (specs/16-scene-log.md, Decisions)."""

from __future__ import annotations

from scenefold.base.errors import DamagedData
from scenefold.wire import SceneLogPublic


class Undecided(DamagedData):
    """A header that nobody shows to have been decided."""


def undecided(public: SceneLogPublic, what: str, remedy: str = "") -> Undecided:
    """That error, for people."""
    return Undecided(what, where=f"scene {public.scene:08x}, log position {public.position}", remedy=remedy)
