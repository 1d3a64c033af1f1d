"""The checks under the payload codecs that hold named values (MessagePack maps; specs/05-scene-content.md).

A page is {"kind": str, "version": int, "first": int, "items": [map, ...]}. Maps have exactly the keys that
their codec knows; anything else is DamagedData that names the payload and the key.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from scenefold.base.errors import DamagedData, PeerFault
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.wire import pack_value, unpack_value

Item = TypeVar("Item")
NAME_LETTERS_MAX = 256
_ITEMS_TRIED = 2_000
"""No page holds more: a value has bounds of its own, which a long table would meet before it is cut."""


class Fields:
    """A decoded map whose fields are taken one by one; `end()` makes sure that none is left."""

    def __init__(self, value: Any, what: str) -> None:
        self._what = what
        self.require(isinstance(value, dict), "is no map")
        self._left: dict[str, Any] = dict(value)

    def require(self, holds: bool, otherwise: str) -> None:
        """DamagedData unless `holds`; `otherwise` completes the sentence "the payload ..."."""
        if not holds:
            raise DamagedData(f"the payload of {self._what} {otherwise}")

    def _take(self, key: str) -> Any:
        self.require(key in self._left, f"lacks {key!r}")
        return self._left.pop(key)

    def has(self, key: str) -> bool:
        """Whether the map has a key that was not taken yet."""
        return key in self._left

    def integer(self, key: str, low: int, high: int) -> int:
        value = self._take(key)
        self.require(type(value) is int and low <= value <= high, f"has an odd {key!r}")
        return int(value)

    def flag(self, key: str) -> bool:
        value = self._take(key)
        self.require(type(value) is bool, f"has an odd {key!r}")
        return bool(value)

    def number(self, key: str, low: float = -math.inf, high: float = math.inf) -> float:
        value = self._take(key)
        self.require(type(value) is float and math.isfinite(value) and low <= value <= high, f"has an odd {key!r}")
        return float(value)

    def numbers(self, key: str, count: int, low: float = -math.inf, high: float = math.inf) -> tuple[float, ...]:
        values = self.sequence(key, count)
        self.require(len(values) == count, f"has {len(values)} numbers in {key!r}, not {count}")
        for value in values:
            self.require(type(value) is float and math.isfinite(value) and low <= value <= high, f"has an odd {key!r}")
        return tuple(values)

    def text(self, key: str, letters_max: int = NAME_LETTERS_MAX) -> str:
        value = self._take(key)
        self.require(isinstance(value, str) and len(value) <= letters_max, f"has an odd {key!r}")
        return str(value)

    def raw(self, key: str) -> bytes:
        value = self._take(key)
        self.require(isinstance(value, bytes), f"has an odd {key!r}")
        return bytes(value)

    def sequence(self, key: str, count_max: int) -> list[Any]:
        value = self._take(key)
        self.require(isinstance(value, list) and len(value) <= count_max, f"has an odd {key!r}")
        return list(value)

    def inner(self, key: str) -> Fields:
        return Fields(self._take(key), f"{self._what}, {key!r},")

    def end(self) -> None:
        self.require(not self._left, f"has unknown fields {sorted(map(repr, self._left))}")


def unpack_fields(payload: bytes, what: str) -> Fields:
    """The map that a payload is."""
    if len(payload) > PAYLOAD_BYTES_MAX:
        raise DamagedData(f"the payload of {what} is larger than a record may be")
    try:
        return Fields(unpack_value(payload, what=what), what)
    except PeerFault as fault:
        raise DamagedData(f"the payload of {what} cannot be read: {fault.what}") from fault


def shorten(name: str) -> str:
    """A name as it is stored: at most 256 letters, and none that UTF-8 lacks (a lone surrogate)."""
    return name[:NAME_LETTERS_MAX].encode("utf-8", "replace").decode("utf-8")


def encode_page(kind: str, version: int, first: int, items: Sequence[dict[str, Any]]) -> bytes:
    return pack_value({"kind": kind, "version": version, "first": first, "items": list(items)})


def encode_pages(kind: str, version: int, items: Sequence[dict[str, Any]], *, first: int = 0) -> list[bytes]:
    """As few pages as simple halving finds, each small enough for a record; none without items."""
    if not items:
        return []
    if len(items) <= _ITEMS_TRIED:
        payload = encode_page(kind, version, first, items)
        if len(payload) <= PAYLOAD_BYTES_MAX:
            return [payload]
    assert len(items) > 1, f"one item of kind {kind} is larger than a record"
    half = len(items) // 2
    return [
        *encode_pages(kind, version, items[:half], first=first),
        *encode_pages(kind, version, items[half:], first=first + half),
    ]


def decode_page(payload: bytes, kind: str, version: int, decode_item: Callable[[Fields], Item]) -> tuple[int, list[Item]]:
    """The number of the first item, and the items."""
    return decode_versions(payload, kind, {version: decode_item})


def decode_versions(payload: bytes, kind: str, decoders: Mapping[int, Callable[[Fields], Item]]) -> tuple[int, list[Item]]:
    """As `decode_page`, of a kind that has several versions: what decodes an item of each."""
    fields = unpack_fields(payload, f"a page of {kind}")
    fields.require(fields.text("kind") == kind, "does not begin with its mark")
    version = fields.integer("version", 0, 2**31)
    fields.require(version in decoders, "has an unknown version")
    first = fields.integer("first", 0, 2**32)
    items = []
    for value in fields.sequence("items", PAYLOAD_BYTES_MAX):
        item = Fields(value, f"a page of {kind}")
        items.append(decoders[version](item))
        item.end()
    fields.end()
    return first, items
