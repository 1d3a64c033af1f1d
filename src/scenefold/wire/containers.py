"""Kinds that hold others: lists, structs, and tagged structs (specs/03-wire.md, Kinds).

As `kinds`, which has the single values: each knows its text in the spec, how it is checked when built, and how it is
read. A struct may have a law between its fields; it is held in both directions.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, TypeVar

from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.wire.errors import Misfit
from scenefold.wire.kinds import Bin, Kind, Place
from scenefold.wire.laws import Law
from scenefold.wire.tokens import TRUNCATED, read_array_head, read_uint

T = TypeVar("T")


class Many(Kind[tuple[T, ...]]):
    """A list of values of one kind; a tuple in Python, because packets are immutable."""

    __slots__ = ("count_max", "counts", "inner")

    def __init__(self, inner: Kind[T], count_max: int = 0, *, counts: tuple[int, ...] = ()) -> None:
        self.inner = inner
        self.counts = counts
        self.count_max = max(counts) if counts else count_max
        self.text = f"[{inner.text}] " + ("|".join(map(str, counts)) if counts else f"≤ {count_max}")

    def plain(self, value: tuple[T, ...]) -> object:
        if type(value) is not tuple and (not isinstance(value, Sequence) or isinstance(value, (str, bytes))):
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


class Strides(Many[T]):
    """A list of byte strings of one size, the lists that are long: read in strides, a fifth of the time that one by
    one takes."""

    __slots__ = ("_head", "_make", "_stride")

    def __init__(self, inner: Kind[T], size: int, count_max: int, make: Callable[[bytes], T]) -> None:
        """`make`: the value of `size` raw bytes, which need no further check."""
        super().__init__(inner, count_max)
        self._make = make
        self._stride = struct.Struct(f">H{size}s")
        # bin 8 and its length, as one number.
        self._head = 0xC400 | size

    def read(self, data: bytes, at: int) -> tuple[tuple[T, ...], int]:
        count, start = read_array_head(data, at)
        self._check(count)
        end = start + count * self._stride.size
        if end > len(data):
            return super().read(data, at)
        head, make = self._head, self._make
        with memoryview(data) as view:
            found = [make(raw) for mark, raw in self._stride.iter_unpack(view[start:end]) if mark == head]
        # One of another size moves all behind it: reading one by one finds out which.
        return (tuple(found), end) if len(found) == count else super().read(data, at)


def _unchecked_location(raw: bytes) -> Location:
    return bytes.__new__(Location, raw)


def many_locations(count_max: int) -> Strides[Location]:
    return Strides(Place(), LOCATION_BYTES, count_max, _unchecked_location)


def many_of_size(size: int, count_max: int) -> Strides[bytes]:
    """A list of byte strings that all have this size, at most 255."""
    return Strides(Bin(lengths=(size,)), size, count_max, bytes)


class Late(Kind[T]):
    """The last field of a struct that is older than it: left out as long as it has nothing to say.

    So what was written before there was such a field keeps its bytes, and what is signed or hashed of them counts as ever.
    """

    __slots__ = ("absent", "inner")

    def __init__(self, inner: Kind[T], absent: T) -> None:
        """`absent`: what it is where it is left out. `inner` refuses that, so that each value has one form."""
        self.inner = inner
        self.absent = absent
        self.text = f"{inner.text} or left out"

    def plain(self, value: T) -> object:
        return self.inner.plain(value)

    def read(self, data: bytes, at: int) -> tuple[T, int]:
        return self.inner.read(data, at)


class Since(Kind[T]):
    """A field at the end of a packet that came with a version: on connections of earlier ones there is none.

    What it is there, and where a peer cannot say it, is its default in the packet's class.
    """

    __slots__ = ("inner", "version")

    def __init__(self, inner: Kind[T], version: int) -> None:
        self.inner = inner
        self.version = version
        self.text = f"{inner.text} since {version}"

    def plain(self, value: T) -> object:
        return self.inner.plain(value)

    def read(self, data: bytes, at: int) -> tuple[T, int]:
        return self.inner.read(data, at)


def since_of(kind: Kind[Any]) -> int:
    """The version that brought a field: the packet's own if none is named."""
    return kind.version if isinstance(kind, Since) else 0


def _nothing(_value: object) -> tuple[()]:
    return ()


class Struct(Kind[T]):
    """A frozen dataclass as an array of its fields, in order. Packets are made of it as well."""

    __slots__ = ("_late", "_plains", "_reads", "_values", "build", "fields", "law", "name")

    def __init__(self, build: Callable[..., T], *fields: tuple[str, Kind[Any]], law: Law | None = None) -> None:
        self.build = build
        self.name = getattr(build, "__name__", "struct")
        self.fields = fields
        assert not any(isinstance(kind, Late) for _, kind in fields[:-1]), "only the last field can be left out"
        self._late = fields[-1][1] if fields and isinstance(fields[-1][1], Late) else None
        # Found once: looking up a method of every field costs a tenth of a packet's time.
        self._plains = [kind.plain for _, kind in fields]
        self._values = attrgetter(*(name for name, _ in fields)) if fields else _nothing
        self._reads = [kind.read for _, kind in fields]
        self.law = law
        self.text = self.name

    def plain(self, value: T) -> object:
        if type(value) is not self.build:
            raise Misfit(f"a {self.name} was expected, not {type(value).__name__}")
        plains = self.plain_fields(value)
        if self.law is not None:
            self._hold(value)
        return plains

    def plain_fields(self, value: T) -> list[object]:
        plains: list[object] = []
        try:
            values = (self._values(value),) if len(self._plains) == 1 else self._values(value)
            if self._late is not None and values[-1] == self._late.absent:
                values = values[:-1]
            for plain, item in zip(self._plains, values, strict=self._late is None):
                plains.append(plain(item))
        except Misfit as misfit:
            raise misfit.inside(f".{self.fields[len(plains)][0]}") from None
        return plains

    def read(self, data: bytes, at: int) -> tuple[T, int]:
        count, at = read_array_head(data, at)
        return self.read_counted(data, at, count)

    def read_counted(self, data: bytes, at: int, count: int) -> tuple[T, int]:
        """The struct behind an array's head that was read already and left `count` fields."""
        left_out = self._late is not None and count == len(self.fields) - 1
        if count != len(self.fields) and not left_out:
            raise Misfit(f"{count} fields, {len(self.fields)} were expected")
        values, at = self.read_fields(data, at, count)
        value = self.build(*values)
        if self.law is not None:
            self._hold(value)
        return value, at

    def _hold(self, value: T) -> None:
        if self.law is not None and not self.law.holds(value):
            raise Misfit(f"not {self.law}")

    def read_fields(self, data: bytes, at: int, count: int | None = None) -> tuple[list[Any], int]:
        """All fields, of which only the first `count` are there."""
        values: list[Any] = []
        try:
            for read in self._reads if count is None else self._reads[:count]:
                value, at = read(data, at)
                values.append(value)
        except Misfit as misfit:
            raise misfit.inside(f".{self.fields[len(values)][0]}") from None
        except TRUNCATED:
            raise Misfit("truncated", f".{self.fields[len(values)][0]}") from None
        if self._late is not None and len(values) < len(self.fields):
            values.append(self._late.absent)
        return values, at


class Tagged(Kind[T]):
    """One of several structs: an array of its number and its fields."""

    __slots__ = ("_number_of", "structs")

    def __init__(self, text: str, structs: dict[int, Struct[Any]]) -> None:
        self.text = text
        self.structs = structs
        self._number_of = {struct.build: number for number, struct in structs.items()}

    def plain(self, value: T) -> object:
        number = self._number_of.get(type(value))
        if number is None:
            raise Misfit(f"a {self.text} was expected, not {type(value).__name__}")
        found = self.structs[number]
        try:
            fields = found.plain(value)
        except Misfit as misfit:
            raise misfit.inside(f"({found.name})") from None
        assert isinstance(fields, list)
        return [number, *fields]

    def read(self, data: bytes, at: int) -> tuple[T, int]:
        count, at = read_array_head(data, at)
        if count < 1:
            raise Misfit(f"a {self.text} begins with its number")
        number, at = read_uint(data, at)
        found = self.structs.get(number)
        if found is None:
            raise Misfit(f"{number} is no {self.text}", unknown=number)
        try:
            return found.read_counted(data, at, count - 1)
        except Misfit as misfit:
            raise misfit.inside(f"({found.name})") from None
