"""Laws between the fields of one packet or struct, held when it is built and when it is read (specs/03-wire.md).

A kind judges one field; what two fields must be to each other stands here. Their text is the spec's.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol


class Law(Protocol):
    """What must hold of a value; its text stands behind the fields in the spec's table."""

    def holds(self, value: Any) -> bool: ...

    def __str__(self) -> str: ...


@dataclass(frozen=True, slots=True)
class Order:
    """`lower` is at most `upper`, or below it if `strictly`; None is no bound."""

    lower: str
    upper: str
    strictly: bool = False

    def holds(self, value: Any) -> bool:
        lower, upper = getattr(value, self.lower), getattr(value, self.upper)
        if lower is None or upper is None:
            return True
        return bool(lower < upper if self.strictly else lower <= upper)

    def __str__(self) -> str:
        return f"{self.lower} {'<' if self.strictly else '≤'} {self.upper}"


@dataclass(frozen=True, slots=True)
class Needs:
    """Where one field is nil, the other is nil too."""

    field: str
    needed: str

    def holds(self, value: Any) -> bool:
        return getattr(value, self.field) is None or getattr(value, self.needed) is not None

    def __str__(self) -> str:
        return f"{self.field} needs {self.needed}"


@dataclass(frozen=True, slots=True)
class Pairs:
    """One of `extras` for each of `items`, or no extras at all."""

    extras: str
    items: str

    def holds(self, value: Any) -> bool:
        count = len(getattr(value, self.extras))
        return count in (0, len(getattr(value, self.items)))

    def __str__(self) -> str:
        return f"{self.extras} 0 or as many as {self.items}"


@dataclass(frozen=True, slots=True)
class OneOf:
    """Of two flags one is set at most: together they would say nothing that makes sense."""

    first: str
    second: str

    def holds(self, value: Any) -> bool:
        return not (getattr(value, self.first) and getattr(value, self.second))

    def __str__(self) -> str:
        return f"at most one of {self.first}, {self.second}"


@dataclass(frozen=True, slots=True)
class Distinct:
    """A list names nothing twice."""

    items: str

    def holds(self, value: Any) -> bool:
        found = getattr(value, self.items)
        return len(set(found)) == len(found)

    def __str__(self) -> str:
        return f"{self.items} distinct"


@dataclass(frozen=True, slots=True)
class Apart:
    """Two lists have nothing in common."""

    first: str
    second: str

    def holds(self, value: Any) -> bool:
        return set(getattr(value, self.first)).isdisjoint(getattr(value, self.second))

    def __str__(self) -> str:
        return f"nothing in both {self.first} and {self.second}"


@dataclass(frozen=True, slots=True)
class Masked:
    """Of an address all is 0 behind its first bits, so that one prefix has one form."""

    address: str
    bits: str

    def holds(self, value: Any) -> bool:
        address, bits = getattr(value, self.address), getattr(value, self.bits)
        return bool(address & ((1 << (32 - bits)) - 1) == 0)

    def __str__(self) -> str:
        return f"{self.address} 0 behind its first {self.bits}"


@dataclass(frozen=True, slots=True)
class Only:
    """A field is there (not nil, not empty) with one value of another field, and with no other."""

    field: str
    other: str
    wanted: IntEnum

    def holds(self, value: Any) -> bool:
        found = getattr(value, self.field)
        return (found is not None and found != b"") == (getattr(value, self.other) is self.wanted)

    def __str__(self) -> str:
        return f"{self.field} with {self.other} {self.wanted.name} alone"


@dataclass(frozen=True, slots=True)
class Inside:
    """The arcs of a list lie in that of their packet."""

    arcs: str

    def holds(self, value: Any) -> bool:
        return all(value.first <= arc.first and arc.last <= value.last for arc in getattr(value, self.arcs))

    def __str__(self) -> str:
        return f"{self.arcs} in first to last"


@dataclass(frozen=True, slots=True)
class All:
    """Several laws at once."""

    laws: tuple[Law, ...]

    def holds(self, value: Any) -> bool:
        return all(law.holds(value) for law in self.laws)

    def __str__(self) -> str:
        return ", ".join(map(str, self.laws))
