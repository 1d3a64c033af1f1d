"""A store's folder opened only to be looked at (specs/21-verify.md): nothing in it changes, and a disk that is read-only is no obstacle.

Readers of a running node register in LMDB's own lock file; here nobody else has the folder, so none is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import lmdb

from scenefold.base.errors import LocalFault
from scenefold.store.folder import FolderLock
from scenefold.store.lmdb_disk import DATA_NAME, opening_fault
from scenefold.store.lmdb_pages import PagesDamaged, check_pages
from scenefold.store.lmdb_transaction import LmdbTransaction
from scenefold.store.sealing import damaged
from scenefold.world.ports import ReadTransaction


@contextmanager
def looked_at(folder: Path, tables: Sequence[str]) -> Iterator[ReadTransaction]:
    """One view of those of the tables that are there. LocalFault if the folder is in use, or holds no store; PagesDamaged.

    Nothing that was in the folder is changed, whatever is wrong with it.
    """
    if not folder.is_dir() or not (folder / DATA_NAME).exists():
        raise LocalFault("there is no store", where=str(folder), remedy="give the folder that the node is run with (`--data`)")
    lock = FolderLock(folder, only_read=True)
    try:
        check_pages(folder / DATA_NAME)
        with _opened(folder, len(tables)) as env, env.begin(buffers=True) as transaction:
            known = {name: found for name in tables if (found := _table(env, transaction, name)) is not None}
            if not known:
                raise LocalFault(f"{DATA_NAME} there is no store of ours", where=str(folder), remedy="give the folder of a node")
            yield _Lacking(LmdbTransaction(transaction, known, int(env.stat()["psize"])), frozenset(known))
    finally:
        lock.release()


@contextmanager
def _opened(folder: Path, tables: int) -> Iterator[lmdb.Environment]:
    try:
        env = lmdb.open(str(folder), readonly=True, lock=False, create=False, max_dbs=tables + 8)
    except (lmdb.InvalidError, lmdb.CorruptedError, lmdb.VersionMismatchError) as error:
        raise PagesDamaged([f"{DATA_NAME} cannot be opened: {error}"], str(folder)) from error
    except lmdb.Error as error:
        raise opening_fault(error, folder) from error
    try:
        yield env
    finally:
        env.close()


def _table(env: lmdb.Environment, transaction: lmdb.Transaction, name: str) -> lmdb._Database | None:
    try:
        return env.open_db(name.encode(), txn=transaction, create=False)
    except lmdb.NotFoundError:
        return None


class _Lacking:
    """Port `ReadTransaction`, of a folder that may lack tables. StoreDamaged where the tree itself cannot be read."""

    def __init__(self, transaction: ReadTransaction, known: frozenset[str]) -> None:
        self._transaction = transaction
        self._known = known

    def get(self, table: str, key: bytes) -> memoryview | None:
        with _named(table):
            return self._transaction.get(table, key) if table in self._known else None

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        if table in self._known:
            with _named(table):
                yield from self._transaction.keys(table, first, last, reverse=reverse)

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        if table in self._known:
            with _named(table):
                yield from self._transaction.scan(table, first, last, reverse=reverse)

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        with _named(table):
            return self._transaction.first(table, first, last) if table in self._known else None


@contextmanager
def _named(table: str) -> Iterator[None]:
    try:
        yield
    except lmdb.Error as error:
        raise damaged(f"the table {table!r} of the store cannot be read to its end: {error}") from error
