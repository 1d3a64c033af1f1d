"""Places on the one line that all spaces of all scenes share, and arcs of it (thesis B.3, specs/01-line.md).

A location is a number of 160 bits, kept as 20 big-endian bytes, so that comparing bytes is comparing
places, and so that the store, the wire and the curves all speak of it without converting.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Self

LOCATION_BITS = 160
LOCATION_BYTES = LOCATION_BITS // 8
LINE_LENGTH = 1 << LOCATION_BITS


class Location(bytes):
    """A place on the line: exactly 20 bytes, big endian. Ordered as the line is."""

    __slots__ = ()

    def __new__(cls, value: bytes) -> Self:
        if len(value) != LOCATION_BYTES:
            raise ValueError(f"a location has {LOCATION_BYTES} bytes, not {len(value)}")
        return super().__new__(cls, value)

    @classmethod
    def from_number(cls, number: int) -> Self:
        """The location with this number, 0 <= number < 2^160; ValueError outside."""
        if not 0 <= number < LINE_LENGTH:
            raise ValueError(f"{number} lies outside the line, 0 to 2^{LOCATION_BITS} - 1")
        return cls(number.to_bytes(LOCATION_BYTES, "big"))

    @classmethod
    def from_padded(cls, value: bytes) -> Self:
        """The location whose trailing zero bytes numpy stripped (scalars of dtype S20 lose them)."""
        return cls(value.ljust(LOCATION_BYTES, b"\0"))

    @classmethod
    def from_digits(cls, text: str, *, filled_with: Literal["0", "f"] = "0") -> Self:
        """As people write places: by the leading hexadecimal digits, 1 to 40 of them, with 0x before them or not.

        `filled_with` stands for the digits that are missing. ValueError with a sentence: above all of an empty text, which
        would otherwise be the first location, where nobody meant to be.
        """
        digits = text.lower().removeprefix("0x")
        if not 1 <= len(digits) <= 2 * LOCATION_BYTES or set(digits) - set("0123456789abcdef"):
            raise ValueError(f"a location has 1 to {2 * LOCATION_BYTES} hexadecimal digits, not {text[:80]!r}")
        return cls(bytes.fromhex(digits.ljust(2 * LOCATION_BYTES, filled_with)))

    @property
    def number(self) -> int:
        return int.from_bytes(self, "big")

    def next(self) -> Location | None:
        """The next location along the line; None behind the last."""
        return None if self == LAST else Location.from_number(self.number + 1)

    def __repr__(self) -> str:
        return f"Location({self.hex()})"


FIRST = Location(bytes(LOCATION_BYTES))
LAST = Location(b"\xff" * LOCATION_BYTES)


@dataclass(frozen=True, slots=True)
class Arc:
    """A piece of the line from `first` to `last`, both included. It never wraps."""

    first: Location
    last: Location

    def __post_init__(self) -> None:
        if self.first > self.last:
            raise ValueError(f"an arc ends at or after its first location: {self.first!r} > {self.last!r}")

    def __contains__(self, location: Location) -> bool:
        return self.first <= location <= self.last

    def intersection(self, other: Arc) -> Arc | None:
        """The locations in both arcs; None if there are none."""
        first, last = max(self.first, other.first), min(self.last, other.last)
        return Arc(first, last) if first <= last else None

    @property
    def length(self) -> int:
        return self.last.number - self.first.number + 1


WHOLE_LINE = Arc(FIRST, LAST)


def even_right_bounds(count: int) -> list[Location]:
    """Right bounds of `count` >= 1 arcs that tile the line as evenly as whole numbers allow."""
    if count < 1:
        raise ValueError("the line needs at least one owner")
    return [Location.from_number(LINE_LENGTH * (index + 1) // count - 1) for index in range(count)]


def arcs_between(right_bounds: Sequence[Location]) -> list[Arc]:
    """The arcs that ascending right bounds cut the line into; the last bound is the line's end."""
    if not right_bounds or right_bounds[-1] != LAST:
        raise ValueError("the last right bound must be the end of the line")
    arcs, first = [], FIRST
    for bound in right_bounds:
        arcs.append(Arc(first, bound))
        following = bound.next()
        if following is not None:
            first = following
    return arcs


def tiles(arcs: Iterable[Arc]) -> bool:
    """Whether arcs, in any order, cover the line from its first location to its last without gap or overlap."""
    expected: Location | None = FIRST
    for arc in sorted(arcs, key=lambda arc: arc.first):
        if arc.first != expected:
            return False
        expected = arc.last.next()
    return expected is None
