"""The tables of a store as a look at all of it needs them: what is damaged in one place hides nothing in another (specs/21-verify.md)."""

from __future__ import annotations

from collections.abc import Iterator

from scenefold.store.sealing import PLAIN, StoreDamaged, opened
from scenefold.world.ports import ReadTransaction

EVERY_KEY = b"", b"\xff" * 256


def is_sound(table: str, key: bytes, stored: memoryview) -> bool:
    """Whether a value is what was written."""
    try:
        opened(table, key, stored)
    except StoreDamaged:
        return False
    return True


class Sound:
    """Port `ReadTransaction`: the values that are what was written, and none of the others."""

    def __init__(self, raw: ReadTransaction) -> None:
        """`raw`: values as they stand on the disk."""
        self._raw = raw

    def get(self, table: str, key: bytes) -> memoryview | None:
        stored = self._raw.get(table, key)
        return stored if stored is None or table in PLAIN else _opened(table, key, stored)

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        if table in PLAIN:
            return self._raw.keys(table, first, last, reverse=reverse)
        return (key for key, _ in self.scan(table, first, last, reverse=reverse))

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        for key, stored in self._raw.scan(table, first, last, reverse=reverse):
            value = stored if table in PLAIN else _opened(table, key, stored)
            if value is not None:
                yield key, value

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        return next(self.scan(table, first, last), None)


def _opened(table: str, key: bytes, stored: memoryview) -> memoryview | None:
    try:
        return opened(table, key, stored)
    except StoreDamaged:
        return None
