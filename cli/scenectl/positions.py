"""Values of options that speak of the world: positions and boxes of any number of coordinates.

What is no position or box of anything is refused as it is read. How many coordinates there must be, and whether a box lies
in a space, is the space's to say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

from cyclopts import Parameter, Token

from scenectl.values import shown_default
from scenefold.base.errors import UsageFault
from scenefold.base.limits import SPACE_DIMENSIONS_MAX


@dataclass(frozen=True)
class Position:
    """Finite coordinates: 1.5,-2,0."""

    coordinates: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        position = cls(_numbers(text))
        if not all(map(math.isfinite, position.coordinates)):
            raise ValueError(f"finite numbers are expected, not {text[:80]!r}")
        return position

    def __str__(self) -> str:
        return ",".join(f"{part:g}" for part in self.coordinates)


@dataclass(frozen=True)
class Box:
    """Low and high corner: 0,0,0:4,3,5."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        low, colon, high = text.partition(":")
        if not colon:
            raise ValueError(f"a box is LOW:HIGH, such as 0,0,0:4,3,5, not {text[:80]!r}")
        box = cls(_numbers(low), _numbers(high))
        if len(box.low) != len(box.high):
            raise ValueError(f"both corners of a box have as many coordinates, not {len(box.low)} and {len(box.high)}")
        for axis, (first, last) in enumerate(zip(box.low, box.high, strict=True)):
            if first > last:
                raise ValueError(f"the box ends at {last:g} before it begins at {first:g} on axis {axis}: give its low corner first")
        return box

    def __str__(self) -> str:
        return f"{Position(self.low)}:{Position(self.high)}"


def check_dimensions(given: int, wanted: int, what: str, where: str) -> None:
    """UsageFault if a position or box has not as many coordinates as the space that it is meant for."""
    if given != wanted:
        words = f"{what} has {wanted} coordinate{'s' if wanted != 1 else ''} here, not {given}"
        raise UsageFault(words, where=where, remedy="give one for each dimension")


def _factor(_kind: Any, tokens: Sequence[Token]) -> float:
    """Reads a factor: finite, and above 0."""
    text = tokens[0].value
    try:
        factor = float(text)
    except ValueError:
        raise ValueError(f"a factor is a number, such as 0.5, not {text[:80]!r}") from None
    if not (math.isfinite(factor) and factor > 0):
        raise ValueError(f"a space is scaled by a finite factor above 0, not {text[:80]}: 0.5 halves it, 2 doubles it")
    return factor


def _numbers(text: str) -> tuple[float, ...]:
    parts = text.split(",")
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError:
        raise ValueError(f"a position is numbers with commas between, such as 1.5,-2,0, not {text[:80]!r}") from None
    if len(numbers) > SPACE_DIMENSIONS_MAX:
        raise ValueError(f"a space has 1 to {SPACE_DIMENSIONS_MAX} dimensions, and no position {len(numbers)} coordinates")
    if any(map(math.isnan, numbers)):
        raise ValueError("a coordinate is not a number (NaN)")
    return numbers


def _convert(kind: type[Position] | type[Box], tokens: Sequence[Token]) -> Any:
    return kind.parse(tokens[0].value)


_ONE_WORD = Parameter(
    converter=_convert, n_tokens=1, accepts_keys=False, negative="", show_default=shown_default, allow_leading_hyphen=True
)

PositionOption = Annotated[Position, _ONE_WORD]
BoxOption = Annotated[Box, _ONE_WORD]
FactorOption = Annotated[float, Parameter(converter=_factor, allow_leading_hyphen=True)]
