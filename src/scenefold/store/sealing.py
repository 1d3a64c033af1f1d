"""Values that nothing else checks carry a checksum (specs/10-store.md, Damage).

A record has checks of its own, a scene's header its signature, a log's rows theirs. Whatever else the store keeps (who the node is, what it owns, what
services noted) is sealed on its way to the disk and opened on its way back, here and nowhere else:

    value | CRC-32 of table, key and value (4)

So a bit that turned over, or a value that stands where another belongs, is never taken for what was written. A node cannot
go on without it, since one copy is all there is: it stops.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from scenefold.base.errors import LocalFault
from scenefold.store.layout import HEADERS, IDENTITY, LOGS, RECORDS, SUSPECTS, TABLES
from scenefold.world.ports import DiskSpace, Environment, ReadTransaction, WriteTransaction

T = TypeVar("T")

PLAIN = frozenset({RECORDS, HEADERS, SUSPECTS, LOGS})
SEALED = tuple(table for table in TABLES if table not in PLAIN)
WIPE = "see to the disk, then wipe the folder: the node comes back as a newcomer (the voter, whose log is nowhere else: put a backup back)"
_CHECK = struct.Struct(">I")
_EVERY_KEY = b"", b"\xff" * 256
_OF_TABLES = {table: zlib.crc32(table.encode()) for table in TABLES}
_OLDER_FORMATS = b"\0\0\0\1", b"\0\0\0\2"
"""Their records are of version 1. The first, and the second at its beginning, had no checksums."""


class StoreDamaged(LocalFault):
    """What the store itself needs has changed on the disk: the node must stop."""


def sealed(table: str, key: bytes, value: bytes) -> bytes:
    """A value as it stands on the disk."""
    return b"".join((value, _CHECK.pack(_checksum(table, key, value))))


def opened(table: str, key: bytes, stored: memoryview) -> memoryview:
    """The value in what stands on the disk; StoreDamaged if that was never written there."""
    end = len(stored) - _CHECK.size
    value = stored[:end]
    if end < 0 or _CHECK.unpack_from(stored, end)[0] != _checksum(table, key, value):
        raise damaged(f"{_name(key)} in the table {table!r} of the store has changed on the disk")
    return value


def damaged(what: str) -> StoreDamaged:
    """An environment adds where."""
    return StoreDamaged(what, remedy=WIPE)


def _checksum(table: str, key: bytes, value: bytes | memoryview) -> int:
    return zlib.crc32(value, zlib.crc32(key, _OF_TABLES[table]))


def _name(key: bytes) -> str:
    return repr(key.decode()) if key.isascii() and key.decode().isprintable() else key.hex()


class SealedEnvironment:
    """An open folder (port `Environment`) whose values are sealed, but for those that have checks of their own."""

    def __init__(self, environment: Environment, where: str) -> None:
        """`where` names the folder in errors."""
        self._environment = environment
        self._where = where

    @contextmanager
    def read(self) -> Iterator[ReadTransaction]:
        with self._named(), self._environment.read() as transaction:
            yield _Reading(transaction)

    def update(self, change: Callable[[WriteTransaction], T]) -> T:
        with self._named():
            return self._environment.update(lambda transaction: change(_Writing(transaction)))

    def space(self) -> DiskSpace:
        return self._environment.space()

    def close(self) -> None:
        self._environment.close()

    def seal_older(self) -> None:
        """Seal what an early version wrote plainly: its format has four bytes, and a bit that turns over changes no length.

        LocalFault, and nothing is changed, if there are records that only an earlier version can read.
        """
        with self._named(), self._environment.read() as transaction:
            stored = transaction.get(IDENTITY, b"format")
            is_plain = stored is not None and bytes(stored) in _OLDER_FORMATS
            version = stored if stored is None or is_plain else opened(IDENTITY, b"format", stored)
            is_older = version is not None and bytes(version) in _OLDER_FORMATS
            if is_older and next(transaction.keys(RECORDS, *_EVERY_KEY), None) is not None:
                raise LocalFault(
                    "the data folder holds records that an earlier scenefold wrote, and this one cannot read",
                    where=self._where,
                    remedy="read what you need with that version, and import it again; then give this node an empty folder",
                )
        if is_plain:
            self._environment.update(_seal_all)

    @contextmanager
    def _named(self) -> Iterator[None]:
        try:
            yield
        except StoreDamaged as damage:
            damage.where = damage.where or self._where
            raise


def _seal_all(transaction: WriteTransaction) -> None:
    for table in SEALED:
        for key in list(transaction.keys(table, *_EVERY_KEY)):
            value = transaction.get(table, key)
            assert value is not None
            transaction.put(table, key, sealed(table, key, bytes(value)))


class _Reading:
    """Port `ReadTransaction`."""

    def __init__(self, transaction: ReadTransaction) -> None:
        self._transaction = transaction

    def get(self, table: str, key: bytes) -> memoryview | None:
        value = self._transaction.get(table, key)
        return value if value is None or table in PLAIN else opened(table, key, value)

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        return self._transaction.keys(table, first, last, reverse=reverse)

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        rows = self._transaction.scan(table, first, last, reverse=reverse)
        return rows if table in PLAIN else self._opened(table, rows)

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        found = self._transaction.first(table, first, last)
        return found if found is None or table in PLAIN else (found[0], opened(table, *found))

    def _opened(self, table: str, rows: Iterator[tuple[bytes, memoryview]]) -> Iterator[tuple[bytes, memoryview]]:
        for key, value in rows:
            yield key, opened(table, key, value)


class _Writing(_Reading):
    """Port `WriteTransaction`."""

    def __init__(self, transaction: WriteTransaction) -> None:
        super().__init__(transaction)
        self._writing = transaction

    def put(self, table: str, key: bytes, value: bytes) -> None:
        self._writing.put(table, key, value if table in PLAIN else sealed(table, key, value))

    def delete(self, table: str, key: bytes) -> bool:
        return self._writing.delete(table, key)
