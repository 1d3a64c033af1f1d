"""Kinds of field: what may stand in it, how it is checked when built and when read (specs/03-wire.md, Kinds).

The table of packets consists of these. A kind knows three things: its text in the spec's table, the plain
MessagePack value of a checked Python value (`plain`), and how to read one from bytes (`read`). All checks of
the wire are here, and both directions use the same bounds, so what we send is what we would accept.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any, Generic, TypeVar

from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.wire.errors import Misfit
from scenefold.wire.tokens import (
    NIL,
    TRUNCATED,
    read_array_head,
    read_bin,
    read_bool,
    read_float,
    read_text,
    read_uint,
)

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
        # bool is an int to Python, but not to MessagePack.
        if not isinstance(value, int) or isinstance(value, bool):
            raise Misfit(f"an integer was expected, not {type(value).__name__}")
        self._check(value)
        return int(value)

    def read(self, data: bytes, at: int) -> tuple[int, int]:
        value, at = read_uint(data, at)
        if not self.least <= value <= self.most:
            self._check(value)
        return value, at

    def _check(self, value: int) -> None:
        if not self.least <= value <= self.most:
            raise Misfit(f"{value} lies outside {self.least} to {self.most}")


class Choice(Kind[E]):
    """A member of an IntEnum."""

    __slots__ = ("members",)

    def __init__(self, members: type[E]) -> None:
        self.members = members
        self.text = f"{members.__name__} {min(members)}..{max(members)}"

    def plain(self, value: E) -> object:
        if not isinstance(value, self.members):
            raise Misfit(f"a {self.members.__name__} was expected, not {value!r}")
        return int(value)

    def read(self, data: bytes, at: int) -> tuple[E, int]:
        value, at = read_uint(data, at)
        try:
            return self.members(value), at
        except ValueError:
            raise Misfit(f"{value} is no {self.members.__name__}") from None


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
    """A finite number of 64 bits."""

    __slots__ = ()

    def __init__(self) -> None:
        self.text = "f64"

    def plain(self, value: float) -> object:
        if not isinstance(value, float):
            raise Misfit(f"a float was expected, not {type(value).__name__}")
        return self._finite(value)

    def read(self, data: bytes, at: int) -> tuple[float, int]:
        value, at = read_float(data, at)
        return self._finite(value), at

    def _finite(self, value: float) -> float:
        if value - value != 0.0:
            raise Misfit(f"{value} is not finite")
        return value


class Bin(Kind[bytes]):
    """Raw bytes: of one of several exact lengths, or up to a limit. Encoding takes any contiguous buffer."""

    __slots__ = ("lengths", "size_max")

    def __init__(self, size_max: int = 0, *, lengths: tuple[int, ...] = ()) -> None:
        self.lengths = lengths
        self.size_max = max(lengths) if lengths else size_max
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
        self._check(size)
        return value

    def read(self, data: bytes, at: int) -> tuple[bytes, int]:
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


class Many(Kind[tuple[T, ...]]):
    """A list of values of one kind; a tuple in Python, because packets are immutable."""

    __slots__ = ("count_max", "counts", "inner")

    def __init__(self, inner: Kind[T], count_max: int = 0, *, counts: tuple[int, ...] = ()) -> None:
        self.inner = inner
        self.counts = counts
        self.count_max = max(counts) if counts else count_max
        self.text = f"[{inner.text}] " + ("|".join(map(str, counts)) if counts else f"≤ {count_max}")

    def plain(self, value: tuple[T, ...]) -> object:
        if not isinstance(value, Sequence) or isinstance(value, (str, bytes)):
            raise Misfit(f"a tuple was expected, not {type(value).__name__}")
        self._check(len(value))
        plain = self.inner.plain
        items: list[object] = []
        try:
            for item in value:
                items.append(plain(item))  # noqa: PERF401  the length says which item failed
        except Misfit as misfit:
            raise misfit.inside(f"[{len(items)}]") from None
        return items

    def read(self, data: bytes, at: int) -> tuple[tuple[T, ...], int]:
        count, at = read_array_head(data, at)
        self._check(count)
        read = self.inner.read
        items: list[T] = []
        try:
            for _ in range(count):
                item, at = read(data, at)
                items.append(item)
        except Misfit as misfit:
            raise misfit.inside(f"[{len(items)}]") from None
        return tuple(items), at

    def _check(self, count: int) -> None:
        if self.counts:
            if count not in self.counts:
                raise Misfit(f"{count} items, {' or '.join(map(str, self.counts))} were expected")
        elif count > self.count_max:
            raise Misfit(f"{count} items, at most {self.count_max} are allowed")


class Places(Many[Location]):
    """A list of locations, the one list that is long: read in strides, a fifth of the time that one by one takes."""

    __slots__ = ()
    _STRIDE = struct.Struct(f">H{LOCATION_BYTES}s")
    _HEAD = 0xC400 | LOCATION_BYTES

    def __init__(self, count_max: int) -> None:
        super().__init__(Place(), count_max)

    def read(self, data: bytes, at: int) -> tuple[tuple[Location, ...], int]:
        count, start = read_array_head(data, at)
        self._check(count)
        end = start + count * self._STRIDE.size
        if end > len(data):
            return super().read(data, at)
        head, make = self._HEAD, bytes.__new__
        with memoryview(data) as view:
            places = [make(Location, raw) for found, raw in self._STRIDE.iter_unpack(view[start:end]) if found == head]
        # One that is no location moves all behind it: reading one by one finds out which.
        return (tuple(places), end) if len(places) == count else super().read(data, at)


class Struct(Kind[T]):
    """A frozen dataclass as an array of its fields, in order. Packets are made of it as well."""

    __slots__ = ("build", "fields", "name")

    def __init__(self, build: Callable[..., T], *fields: tuple[str, Kind[Any]]) -> None:
        self.build = build
        self.name = getattr(build, "__name__", "struct")
        self.fields = fields
        self.text = self.name

    def plain(self, value: T) -> object:
        if type(value) is not self.build:
            raise Misfit(f"a {self.name} was expected, not {type(value).__name__}")
        return self.plain_fields(value)

    def plain_fields(self, value: T) -> list[object]:
        plains: list[object] = []
        for name, kind in self.fields:
            try:
                plains.append(kind.plain(getattr(value, name)))
            except Misfit as misfit:
                raise misfit.inside(f".{name}") from None
        return plains

    def read(self, data: bytes, at: int) -> tuple[T, int]:
        count, at = read_array_head(data, at)
        if count != len(self.fields):
            raise Misfit(f"{count} fields, {len(self.fields)} were expected")
        values, at = self.read_fields(data, at)
        return self.build(*values), at

    def read_fields(self, data: bytes, at: int) -> tuple[list[Any], int]:
        values: list[Any] = []
        try:
            for _, kind in self.fields:
                value, at = kind.read(data, at)
                values.append(value)
        except Misfit as misfit:
            raise misfit.inside(f".{self.fields[len(values)][0]}") from None
        except TRUNCATED:
            raise Misfit("truncated", f".{self.fields[len(values)][0]}") from None
        return values, at
