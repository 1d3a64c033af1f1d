"""An LMDB transaction in our words (ports `ReadTransaction`, `WriteTransaction`; specs/10-store.md)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import cast

import lmdb

TREE_PAGES_MAX = 8
"""Pages from a root to a leaf, with splits; and what a commit needs for its list of free pages."""


class LmdbTransaction:
    """An LMDB transaction in our words."""

    def __init__(self, transaction: lmdb.Transaction, tables: Mapping[str, lmdb._Database], page_bytes: int) -> None:
        self._transaction = transaction
        self._tables = tables
        self._page_bytes = page_bytes
        self.dirty_bytes_max = page_bytes * TREE_PAGES_MAX
        """What the commit may write: the changed values, and for each the pages above it."""

    def get(self, table: str, key: bytes) -> memoryview | None:
        return cast("memoryview | None", self._transaction.get(key, db=self._tables[table]))

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        with self._transaction.cursor(self._tables[table]) as cursor:
            if _begin(cursor, first, last, reverse):
                for key in (cursor.iterprev if reverse else cursor.iternext)(keys=True, values=False):
                    found = bytes(key)
                    if not first <= found <= last:
                        return
                    yield found

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        with self._transaction.cursor(self._tables[table]) as cursor:
            if _begin(cursor, first, last, reverse):
                for key, value in (cursor.iterprev if reverse else cursor.iternext)():
                    found = bytes(key)
                    if not first <= found <= last:
                        return
                    yield found, cast(memoryview, value)

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        with self._transaction.cursor(self._tables[table]) as cursor:
            if not cursor.set_range(first):
                return None
            key, value = cursor.item()
            found = bytes(key)
            return (found, cast(memoryview, value)) if found <= last else None

    def put(self, table: str, key: bytes, value: bytes) -> None:
        self.dirty_bytes_max += len(value) + self._page_bytes * (TREE_PAGES_MAX + 2)
        self._transaction.put(key, value, db=self._tables[table])

    def delete(self, table: str, key: bytes) -> bool:
        self.dirty_bytes_max += self._page_bytes * TREE_PAGES_MAX
        return self._transaction.delete(key, db=self._tables[table])


def _begin(cursor: lmdb.Cursor, first: bytes, last: bytes, reverse: bool) -> bool:
    """Stand on the first entry of a walk; False if there is none in that direction."""
    if not reverse:
        return bool(cursor.set_range(first))
    # LMDB looks upwards only: the entry behind `last` is found, or there is none and the walk begins at the end.
    if not cursor.set_range(last):
        return bool(cursor.last())
    return bytes(cursor.key()) <= last or bool(cursor.prev())
