"""A render whose client goes away meanwhile, and what it needs to know when it is back (specs/19-jobs.md, Unattended renders). Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.image_limits import EXPOSURE_MAX
from scenefold.base.names import is_name
from scenefold.base.plain_values import number, text

ALL_JOBS = 0
"""Whoever asks how this one stands is told of all that it asked for."""
IMAGE_KEPT_S = 24 * 3600.0
"""A finished image, or why there is none, for whoever comes back."""


@dataclass(frozen=True, slots=True)
class Unattended:
    """What the client knows of the image beside its options."""

    scene: str
    """Its name, as this client has it."""
    exposure: float | None = None
    """Of the picture for people, in stops; None: as the image asks."""

    def row(self) -> list[str | float | None]:
        """Plain values."""
        return [self.scene, self.exposure]

    @classmethod
    def of_row(cls, row: Any) -> Self | None:
        """What `row` gave, or None for None; ValueError or TypeError for anything else."""
        if row is None:
            return None
        scene, exposure = row
        stops = None if exposure is None else number(exposure)
        if not is_name(text(scene)) or (stops is not None and abs(stops) > EXPOSURE_MAX):
            raise ValueError("a scene's name and an exposure are expected")
        return cls(scene, stops)
