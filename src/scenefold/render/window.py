"""A part of an image. Its pixels are those of the whole image, and so are their random numbers. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import UsageFault
from scenefold.base.image_limits import SIDE_MAX
from scenefold.base.plain_values import whole


@dataclass(frozen=True, slots=True)
class Window:
    """In pixels from the upper left corner of the image."""

    x: int
    y: int
    width: int
    height: int

    @property
    def pixels(self) -> int:
        """How many there are."""
        return self.width * self.height

    def check(self, width: int, height: int) -> None:
        """UsageFault unless it is a part of an image of this size."""
        if not (0 <= self.x < self.x + self.width <= width and 0 <= self.y < self.y + self.height <= height):
            raise UsageFault(
                f"the crop {self.x},{self.y},{self.width},{self.height} is no part of an image of {width}x{height}",
                where="crop",
                remedy="give X,Y,WIDTH,HEIGHT in pixels from the upper left corner",
            )

    def scaled(self, scale: float, width: int, height: int) -> Window:
        """The pixels of the image of this smaller size that show anything of it."""
        left, upper = min(math.floor(self.x * scale), width - 1), min(math.floor(self.y * scale), height - 1)
        right = min(math.ceil((self.x + self.width) * scale), width)
        lower = min(math.ceil((self.y + self.height) * scale), height)
        return Window(left, upper, max(right - left, 1), max(lower - upper, 1))

    def row(self) -> list[int]:
        """Plain values."""
        return [self.x, self.y, self.width, self.height]

    @classmethod
    def of_row(cls, row: Any) -> Self | None:
        """What `row` gave, or None for None; ValueError or TypeError for anything else."""
        if row is None:
            return None
        x, y, width, height = (whole(value, 0, SIDE_MAX) for value in row)
        return cls(x, y, width, height)
