"""Kinds of field: what may stand in it, how it is checked when built and when read (specs/03-wire.md, Kinds).

The table of packets consists of these, and of the `containers` that hold several. A kind knows three things: its text in the spec's table, the plain
MessagePack value of a checked Python value (`plain`), and how to read one from bytes (`read`). All checks of
the wire are here, and both directions use the same bounds, so what we send is what we would accept.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container
from enum import IntEnum
from typing import Generic, TypeVar

from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.wire.errors import Misfit
from scenefold.wire.tokens import (
    NIL,
    read_bin,
    read_bool,
    read_float,
    read_text,
    read_uint,
)

_BIN_8, _BIN_16 = 0xC4, 0xC5

T = TypeVar("T")
E = TypeVar("E", bound=IntEnum)


class Kind(ABC, Generic[T]):
    """One kind of field. `text` is how the spec's table writes it."""

    __slots__ = ("text",)
    text: str

    @abstractmethod
    def plain(self, value: T) -> object:
        """The value as MessagePack knows it; Misfit if it is not of this kind."""

    @abstractmethod
    def read(self, data: bytes, at: int) -> tuple[T, int]:
        """The value that begins at `at`, and the position behind it; Misfit if it is not of this kind."""


class Uint(Kind[int]):
    """An unsigned integer from `least` to `most`."""

    __slots__ = ("least", "most")

    def __init__(self, bits: int, *, least: int = 0, most: int | None = None) -> None:
        self.least = least
        self.most = (1 << bits) - 1 if most is None else most
        bounds = "" if most is None and least == 0 else f" {least}..{'' if most is None else most}"
        self.text = f"u{bits}{bounds}"

    def plain(self, value: int) -> object:
        if type(value) is int and self.least <= value <= self.most:
            return value  # Nearly all: packets consist of numbers.
        # bool is an int to Python, but not to MessagePack.
        if not isinstance(value, int) or isinstance(value, bool):
            raise Misfit(f"an integer was expected, not {type(value).__name__}")
        self._check(value)
        return int(value)

    def read(self, data: bytes, at: int) -> tuple[int, int]:
        value = data[at]
        if value < 0x80:
            at += 1
        else:
            value, at = read_uint(data, at)
        if not self.least <= value <= self.most:
            self._check(value)
        return value, at

    def _check(self, value: int) -> None:
        if not self.least <= value <= self.most:
            raise Misfit(f"{value} lies outside {self.least} to {self.most}")


class Choice(Kind[E]):
    """A member of an IntEnum; `most`: none above this one."""

    __slots__ = ("members", "name")

    def __init__(self, members: type[E], most: E | None = None) -> None:
        self.members = tuple(member for member in members if most is None or member <= most)
        self.name = members.__name__
        self.text = f"{self.name} {min(self.members)}..{max(self.members)}"

    def plain(self, value: E) -> object:
        if type(value) is not type(self.members[0]) or value not in self.members:
            raise Misfit(f"a {self.name} was expected, not {value!r}")
        return int(value)

    def read(self, data: bytes, at: int) -> tuple[E, int]:
        value, at = read_uint(data, at)
        for member in self.members:
            if member == value:
                return member, at
        raise Misfit(f"{value} is no {self.name}")


class Flag(Kind[bool]):
    """True or false."""

    __slots__ = ()

    def __init__(self) -> None:
        self.text = "bool"

    def plain(self, value: bool) -> object:
        if not isinstance(value, bool):
            raise Misfit(f"true or false was expected, not {type(value).__name__}")
        return value

    def read(self, data: bytes, at: int) -> tuple[bool, int]:
        return read_bool(data, at)


class Float(Kind[float]):
    """A finite number of 64 bits; above 0 if it must be `positive`."""

    __slots__ = ("positive",)

    def __init__(self, *, positive: bool = False) -> None:
        self.positive = positive
        self.text = "f64 > 0" if positive else "f64"

    def plain(self, value: float) -> object:
        if not isinstance(value, float):
            raise Misfit(f"a float was expected, not {type(value).__name__}")
        return self._checked(value)

    def read(self, data: bytes, at: int) -> tuple[float, int]:
        value, at = read_float(data, at)
        return self._checked(value), at

    def _checked(self, value: float) -> float:
        if value - value != 0.0:
            raise Misfit(f"{value} is not finite")
        if self.positive and not value > 0.0:
            raise Misfit(f"{value} is not above 0")
        return value


class Bin(Kind[bytes]):
    """Raw bytes: of one of several exact lengths, or up to a limit. Encoding takes any contiguous buffer."""

    __slots__ = ("_sizes", "lengths", "size_max")

    def __init__(self, size_max: int = 0, *, lengths: tuple[int, ...] = ()) -> None:
        self.lengths = lengths
        self.size_max = max(lengths) if lengths else size_max
        self._sizes: Container[int] = frozenset(lengths) if lengths else range(size_max + 1)
        self.text = "bin " + ("|".join(map(str, lengths)) if lengths else f"≤ {size_max}")

    def plain(self, value: bytes) -> object:
        if isinstance(value, bytes):
            size = len(value)
        else:
            try:
                view = memoryview(value)
            except TypeError:
                raise Misfit(f"bytes were expected, not {type(value).__name__}") from None
            if not view.c_contiguous:
                raise Misfit("a contiguous buffer was expected")
            size, value = view.nbytes, view
        if size not in self._sizes:
            self._check(size)
        return value

    def read(self, data: bytes, at: int) -> tuple[bytes, int]:
        # Records consist of these, so what is as it should be takes no further call; `read_bin` says what is wrong with the rest.
        head = data[at]
        if head == _BIN_8:
            size, start = data[at + 1], at + 2
        elif head == _BIN_16:
            size, start = data[at + 1] << 8 | data[at + 2], at + 3
        else:
            size = -1
        if size in self._sizes and (size > 0xFF or head == _BIN_8):
            end = start + size
            if end <= len(data):
                return data[start:end], end
        value, at = read_bin(data, at, self.size_max)
        if self.lengths:
            self._check(len(value))
        return value, at

    def _check(self, size: int) -> None:
        if self.lengths:
            if size not in self.lengths:
                raise Misfit(f"{size} bytes, {' or '.join(map(str, self.lengths))} were expected")
        elif size > self.size_max:
            raise Misfit(f"{size} bytes, at most {self.size_max} are allowed")


class Text(Kind[str]):
    """UTF-8, at most `size_max` bytes."""

    __slots__ = ("size_max",)

    def __init__(self, size_max: int) -> None:
        self.size_max = size_max
        self.text = f"text ≤ {size_max}"

    def plain(self, value: str) -> object:
        if not isinstance(value, str):
            raise Misfit(f"a text was expected, not {type(value).__name__}")
        try:
            size = len(value.encode())
        except UnicodeEncodeError:
            raise Misfit("a text that UTF-8 cannot write") from None
        if size > self.size_max:
            raise Misfit(f"{size} bytes, at most {self.size_max} are allowed")
        return value

    def read(self, data: bytes, at: int) -> tuple[str, int]:
        return read_text(data, at, self.size_max)


class Place(Kind[Location]):
    """A location: 20 bytes."""

    __slots__ = ()

    def __init__(self) -> None:
        self.text = "Location"

    def plain(self, value: Location) -> object:
        if not isinstance(value, bytes) or len(value) != LOCATION_BYTES:
            raise Misfit(f"a location of {LOCATION_BYTES} bytes was expected, not {value!r:.80}")
        return bytes(value)

    def read(self, data: bytes, at: int) -> tuple[Location, int]:
        end = at + 2 + LOCATION_BYTES
        if data[at] == _BIN_8 and data[at + 1] == LOCATION_BYTES and end <= len(data):
            return bytes.__new__(Location, data[at + 2 : end]), end
        value, at = read_bin(data, at, LOCATION_BYTES)
        if len(value) != LOCATION_BYTES:
            raise Misfit(f"{len(value)} bytes, {LOCATION_BYTES} were expected")
        return Location(value), at


class Maybe(Kind[T | None]):
    """Nil, or a value of another kind."""

    __slots__ = ("inner",)

    def __init__(self, inner: Kind[T]) -> None:
        self.inner = inner
        self.text = f"{inner.text}?"

    def plain(self, value: T | None) -> object:
        return None if value is None else self.inner.plain(value)

    def read(self, data: bytes, at: int) -> tuple[T | None, int]:
        if data[at] == NIL:
            return None, at + 1
        return self.inner.read(data, at)


class Nothing(Kind[None]):
    """Always nil."""

    __slots__ = ()

    def __init__(self) -> None:
        self.text = "nil"

    def plain(self, value: None) -> object:
        if value is not None:
            raise Misfit("nothing may stand here")
        return value

    def read(self, data: bytes, at: int) -> tuple[None, int]:
        if data[at] != NIL:
            raise Misfit("nil was expected")
        return None, at + 1
