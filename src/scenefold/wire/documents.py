"""Documents: maps, lists, numbers, texts and bytes with exactly one encoding (specs/03-wire.md, Documents).

Payload codecs and jobs use these for what is small and may grow, a scene's description say. Canonical: keys are
texts in ascending order of their UTF-8 bytes, integers and lengths in the shortest form, floats of 64 bits. So equal
values have equal bytes, and hashing the bytes is hashing the value. Depth, number of items and bytes are bounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import msgpack

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX, VALUE_DEPTH_MAX, VALUE_ITEMS_MAX
from scenefold.wire.errors import MalformedPacket, Misfit
from scenefold.wire.tokens import (
    FALSE,
    NIL,
    TRUE,
    TRUNCATED,
    read_array_head,
    read_bin,
    read_float,
    read_map_head,
    read_negative,
    read_text,
    read_uint,
)

Value: TypeAlias = Any
"""None, bool, int, float, str, bytes, a list of values, or a dict from str to values."""

_INT_MIN, _INT_MAX = -(1 << 63), (1 << 64) - 1
_AS_THEY_ARE = frozenset((type(None), bool, bytes))
_CONTAINERS = frozenset((list, dict))
_TEXT_HEADS = frozenset((*range(0xA0, 0xC0), 0xD9, 0xDA, 0xDB))
_ARRAY_HEADS = frozenset((*range(0x90, 0xA0), 0xDC, 0xDD))
_MAP_HEADS = frozenset((*range(0x80, 0x90), 0xDE, 0xDF))
_UINT_HEADS = frozenset((*range(0x80), 0xCC, 0xCD, 0xCE, 0xCF))
_NEGATIVE_HEADS = frozenset((*range(0xE0, 0x100), 0xD0, 0xD1, 0xD2, 0xD3))


class _Budget:
    """Counts items down; packing and unpacking spend alike, so that what packs also unpacks."""

    __slots__ = ("left",)

    def __init__(self) -> None:
        self.left = VALUE_ITEMS_MAX

    def spend(self, items: int, depth: int) -> None:
        if depth > VALUE_DEPTH_MAX:
            raise Misfit(f"nested deeper than {VALUE_DEPTH_MAX}")
        self.left -= items
        if self.left < 0:
            raise Misfit(f"more than {VALUE_ITEMS_MAX} items")


def pack_value(value: Value, *, what: str = "document", size_max: int = FRAME_BYTES_MAX) -> bytes:
    """The one encoding of a value; LocalFault if it cannot have one. Tuples pack as lists."""
    try:
        packed: bytes = msgpack.packb(_canonical(value, _Budget(), 0))
        if len(packed) > size_max:
            raise Misfit(f"{len(packed)} bytes, at most {size_max} are allowed")
    except Misfit as misfit:
        raise LocalFault(f"cannot be packed: {misfit.problem}", where=f"{what}{misfit.path}") from None
    return packed


def _canonical(value: Value, budget: _Budget, depth: int) -> Value:
    if isinstance(value, (list, tuple)):
        budget.spend(len(value), depth + 1)
        return [item if _is_plain(item, depth + 1) else _canonical_at(item, budget, depth + 1, index) for index, item in enumerate(value)]
    if isinstance(value, dict):
        budget.spend(2 * len(value), depth + 1)
        keys = sorted(value, key=_utf8) if value else ()
        return {str(key): _canonical_at(value[key], budget, depth + 1, key) for key in keys}
    if value is None or isinstance(value, (bool, bytes)):
        return value
    if isinstance(value, int):
        if not _INT_MIN <= value <= _INT_MAX:
            raise Misfit("an integer of more than 64 bits")
        return int(value)
    if isinstance(value, float):
        if math.isnan(value):
            raise Misfit("not a number")
        return float(value)
    if isinstance(value, str):
        _utf8(value)
        return str(value)
    if isinstance(value, (bytearray, memoryview)):
        return bytes(value)
    raise Misfit(f"a {type(value).__name__} has no encoding")


def _is_plain(item: Value, depth: int) -> bool:
    """Whether an item of a list is its own canonical form: what lists of many items mostly consist of."""
    kind = type(item)
    if kind is int:
        return bool(_INT_MIN <= item <= _INT_MAX)
    return kind in _AS_THEY_ARE or (kind in _CONTAINERS and not item and depth < VALUE_DEPTH_MAX)


def _canonical_at(value: Value, budget: _Budget, depth: int, at: int | str) -> Value:
    try:
        return _canonical(value, budget, depth)
    except Misfit as misfit:
        raise misfit.inside(f"[{at}]" if isinstance(at, int) else _label(at)) from None


def _label(key: str) -> str:
    """A key in a path that people will read: a stranger may have chosen it."""
    short = key if len(key) <= 40 else f"{key[:40]}…"
    return f".{short if short.isprintable() else ascii(short)}"


def _utf8(text: object) -> bytes:
    if not isinstance(text, str):
        raise Misfit(f"a key must be a text, not {type(text).__name__}")
    try:
        return text.encode()
    except UnicodeEncodeError:
        raise Misfit("a text that UTF-8 cannot write") from None


def unpack_value(data: bytes | bytearray | memoryview, *, what: str = "document", size_max: int = FRAME_BYTES_MAX) -> Value:
    """The value that `data` is the one encoding of; MalformedPacket otherwise."""
    if len(data) > size_max:
        raise MalformedPacket(what, f"{len(data)} bytes, at most {size_max} are allowed")
    data = bytes(data)
    try:
        value, end = _read_value(data, 0, _Budget(), 0)
        if end != len(data):
            raise Misfit(f"{len(data) - end} bytes too many")
    except Misfit as misfit:
        raise MalformedPacket(f"{what}{misfit.path}", misfit.problem) from None
    except TRUNCATED:
        raise MalformedPacket(what, "truncated") from None
    return value


def skip_value(data: bytes, at: int) -> int:
    """The position behind the value at `at`: for fields that a later version appended."""
    return _read_value(data, at, _Budget(), 0)[1]


_CONSTANTS = {NIL: None, FALSE: False, TRUE: True}
_ONE_BYTE: dict[int, Value] = {
    **{head: head for head in range(0x80)},
    **{head: head - 0x100 for head in range(0xE0, 0x100)},
    **_CONSTANTS,
    0xA0: "",
}
"""Values that are their head: of these a stranger can put most into a document, so a list of them must cost little."""
_EMPTY: dict[int, Callable[[], Value]] = {0x80: dict, 0x90: list}


def _read_value(data: bytes, at: int, budget: _Budget, depth: int) -> tuple[Value, int]:
    head = data[at]
    if head in _UINT_HEADS:
        return read_uint(data, at)
    if head in _TEXT_HEADS:
        return read_text(data, at, len(data))
    if head == 0xCB:
        return read_float(data, at)
    if head in _CONSTANTS:
        return _CONSTANTS[head], at + 1
    if head in _NEGATIVE_HEADS:
        return read_negative(data, at)
    if head in _ARRAY_HEADS:
        return _read_list(data, at, budget, depth + 1)
    if head in _MAP_HEADS:
        return _read_map(data, at, budget, depth + 1)
    return read_bin(data, at, len(data))


def _read_list(data: bytes, at: int, budget: _Budget, depth: int) -> tuple[Value, int]:
    count, at = read_array_head(data, at)
    budget.spend(count, depth)
    items: list[Value] = []
    try:
        for _ in range(count):
            head = data[at]
            if head in _ONE_BYTE:
                items.append(_ONE_BYTE[head])
                at += 1
            elif head in _EMPTY and depth < VALUE_DEPTH_MAX:
                items.append(_EMPTY[head]())
                at += 1
            else:
                item, at = _read_value(data, at, budget, depth)
                items.append(item)
    except Misfit as misfit:
        raise misfit.inside(f"[{len(items)}]") from None
    return items, at


def _read_map(data: bytes, at: int, budget: _Budget, depth: int) -> tuple[Value, int]:
    count, at = read_map_head(data, at)
    budget.spend(2 * count, depth)
    pairs: dict[str, Value] = {}
    before = b""
    for index in range(count):
        key, at = read_text(data, at, len(data))
        raw = key.encode()
        if index and raw <= before:
            raise Misfit("keys must ascend", _label(key))
        before = raw
        try:
            pairs[key], at = _read_value(data, at, budget, depth)
        except Misfit as misfit:
            raise misfit.inside(_label(key)) from None
    return pairs, at
