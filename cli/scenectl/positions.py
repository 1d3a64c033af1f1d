"""Values of options that speak of the world: positions and boxes of any number of coordinates.

How many coordinates there must be, and whether a box lies in a space, is the space's to say; here they are only read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Self

from cyclopts import Parameter, Token

COORDINATES_MAX = 64
"""More are no position of anything, and would fill the screen with the complaint about them."""


@dataclass(frozen=True)
class Position:
    """Coordinates: 1.5,-2,0."""

    coordinates: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> Self:
        return cls(_numbers(text))

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
        return cls(_numbers(low), _numbers(high))

    def __str__(self) -> str:
        return f"{Position(self.low)}:{Position(self.high)}"


def _numbers(text: str) -> tuple[float, ...]:
    parts = text.split(",")
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError:
        raise ValueError(f"a position is numbers with commas between, such as 1.5,-2,0, not {text[:80]!r}") from None
    if len(numbers) > COORDINATES_MAX:
        raise ValueError(f"a position of {len(numbers)} coordinates")
    return numbers


def _convert(kind: type[Position] | type[Box], tokens: Sequence[Token]) -> Any:
    return kind.parse(tokens[0].value)


_ONE_WORD = Parameter(converter=_convert, n_tokens=1, accepts_keys=False, negative="", show_default=str, allow_leading_hyphen=True)

PositionOption = Annotated[Position, _ONE_WORD]
BoxOption = Annotated[Box, _ONE_WORD]
