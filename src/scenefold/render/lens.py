"""A camera's lens: what lies off its plane of focus is blurred (specs/07-rays.md, *Where rays begin*). Pure.

A thin lens: light that leaves a point of the plane of focus meets in one point of the image, whatever part of the lens it came through.
Without one a camera is a pinhole, and everything is sharp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import UsageFault
from scenefold.base.image_limits import FOCUS_MIN
from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.base.plain_values import number


@dataclass(frozen=True, slots=True)
class Lens:
    """Lengths in the world's unit."""

    aperture: float
    """Radius of the lens; above 0."""
    focus: float
    """How far the plane of focus is from the camera, along the way that it looks."""

    def check(self) -> None:
        """UsageFault if no camera has it."""
        bounds = (("aperture", self.aperture, 0.0), ("focus", self.focus, FOCUS_MIN))
        for name, value, least in bounds:
            if not least <= value <= COORDINATE_ABS_MAX or value == 0.0:
                raise UsageFault(f"{name} is {value}", where=name, remedy="give a length above 0 in the world's unit, up to 1e9")

    def row(self) -> list[float]:
        """Plain values."""
        return [float(self.aperture), float(self.focus)]

    @classmethod
    def of_row(cls, row: Any) -> Self | None:
        """What `row` gave, or None for None; ValueError or TypeError for anything else."""
        if row is None:
            return None
        aperture, focus = (number(value) for value in row)
        return cls(aperture, focus)


def lens_of(aperture: float | None, focus: float | None) -> Lens | None:
    """The lens that two options ask for; UsageFault if one stands there without the other."""
    if aperture is None and focus is None:
        return None
    if aperture is None or focus is None:
        missing, given = ("focus", "an aperture") if focus is None else ("aperture", "a focus")
        raise UsageFault(f"{given} is given, and no {missing}", where=missing, remedy="give both, or none for a pinhole camera")
    return Lens(aperture, focus)
