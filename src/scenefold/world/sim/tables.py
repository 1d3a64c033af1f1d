"""Ordered tables in memory: what a simulated disk holds, and the views that transactions have of it.

A `Table` is a dict with a sorted list of its keys. Whoever reads holds on to it; a commit that finds a reader works on a
copy, so a reader sees one moment. A writing view keeps its changes beside the table until they are committed.

Views are stricter than LMDB's: a value's memoryview is released with its transaction, and in a writing transaction with
the next change, and using it then is an error. LMDB would hand out other bytes.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterator, Mapping

KEY_BYTES_MAX = 511
"""LMDB's bound."""
ENTRY_OVERHEAD_BYTES = 16


class Table:
    """Keys in order, with values."""

    __slots__ = ("bytes", "keys", "readers", "values")

    def __init__(self) -> None:
        self.keys: list[bytes] = []
        self.values: dict[bytes, bytes] = {}
        self.bytes = 0
        """What the entries take."""
        self.readers = 0

    def copy(self) -> Table:
        other = Table()
        other.keys, other.values, other.bytes = self.keys[:], dict(self.values), self.bytes
        return other

    def set(self, key: bytes, value: bytes | None) -> None:
        """Write a value, or delete with None."""
        before = self.values.get(key)
        if before is not None:
            self.bytes -= size_of(key, before)
        if value is None:
            if before is not None:
                del self.values[key]
                del self.keys[bisect_left(self.keys, key)]
            return
        if before is None:
            insort(self.keys, key)
        self.values[key] = value
        self.bytes += size_of(key, value)


def size_of(key: bytes, value: bytes) -> int:
    return len(key) + len(value) + ENTRY_OVERHEAD_BYTES


class ReadView:
    """Port `ReadTransaction` over tables that stand still meanwhile."""

    def __init__(self, tables: Mapping[str, Table]) -> None:
        self._tables = tables
        self._lent: list[memoryview] = []
        self._is_open = True

    def get(self, table: str, key: bytes) -> memoryview | None:
        self._check()
        value = self._tables[table].values.get(key)
        return self._lend(value) if value is not None else None

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        keys = self._tables[table].keys
        places = range(bisect_left(keys, first), bisect_right(keys, last))
        for place in reversed(places) if reverse else places:
            self._check()
            yield keys[place]

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        for key in self.keys(table, first, last, reverse=reverse):
            value = self.get(table, key)
            assert value is not None
            yield key, value

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        return next(self.scan(table, first, last), None)

    def _check(self) -> None:
        assert self._is_open, "a transaction is used after its end"

    def _lend(self, value: bytes) -> memoryview:
        view = memoryview(value)
        self._lent.append(view)
        return view

    def take_back(self) -> None:
        """What was lent is not valid any more."""
        for view in self._lent:
            view.release()
        self._lent.clear()

    def end(self) -> None:
        self._is_open = False
        self.take_back()


class WriteView(ReadView):
    """Port `WriteTransaction`: sees its own changes, which are in `changes` until somebody commits them."""

    def __init__(self, tables: Mapping[str, Table]) -> None:
        super().__init__(tables)
        self.changes: dict[str, dict[bytes, bytes | None]] = {name: {} for name in tables}
        self._new_keys: dict[str, list[bytes]] = {name: [] for name in tables}
        """Those that the table does not have, in order."""

    def get(self, table: str, key: bytes) -> memoryview | None:
        changes = self.changes[table]
        if key not in changes:
            return super().get(table, key)
        self._check()
        value = changes[key]
        return self._lend(value) if value is not None else None

    def put(self, table: str, key: bytes, value: bytes) -> None:
        self._check()
        assert 0 < len(key) <= KEY_BYTES_MAX, f"a key of {len(key)} bytes"
        self.take_back()
        key = bytes(key)
        if key not in self.changes[table] and key not in self._tables[table].values:
            insort(self._new_keys[table], key)
        self.changes[table][key] = bytes(value)

    def delete(self, table: str, key: bytes) -> bool:
        self._check()
        self.take_back()
        changes = self.changes[table]
        there = changes[key] if key in changes else self._tables[table].values.get(key)
        if there is not None:
            changes[bytes(key)] = None
        return there is not None

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        # Looks for the next key from the last one each time, so changes may be made on the way.
        old, new, changes = self._tables[table].keys, self._new_keys[table], self.changes[table]
        following = _before if reverse else _from
        old_key, new_key = following(old, first, last, None), following(new, first, last, None)
        while old_key is not None or new_key is not None:
            if new_key is None or (old_key is not None and (old_key > new_key if reverse else old_key < new_key)):
                key = old_key
            else:
                key = new_key
            assert key is not None
            self._check()
            if changes.get(key, b"") is not None:
                yield key
            old_key, new_key = following(old, first, last, key), following(new, first, last, key)


def _from(keys: list[bytes], first: bytes, last: bytes, after: bytes | None) -> bytes | None:
    place = bisect_left(keys, first) if after is None else bisect_right(keys, after)
    return keys[place] if place < len(keys) and keys[place] <= last else None


def _before(keys: list[bytes], first: bytes, last: bytes, after: bytes | None) -> bytes | None:
    place = (bisect_right(keys, last) if after is None else bisect_left(keys, after)) - 1
    return keys[place] if place >= 0 and keys[place] >= first else None
