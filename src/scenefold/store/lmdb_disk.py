"""The door to LMDB (port `Disk`; specs/10-store.md).

One folder is one LMDB environment with a named table for each of ours. Every commit is synced. The map begins small
(a process may run under a limit of address space) and doubles when it is full: all transactions end, the environment
is closed and opened again with a larger map, and the change runs anew. Opening again, rather than resizing in place,
leaves a way back if the larger map cannot be had.

A new file is made beside, and gets its name when it is whole: so an empty file of that name is never a store's beginning.

Before a commit the file is lengthened by what the commit may write at most, and some way ahead (`preallocation.py`).
"""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import lmdb

from scenefold.base.errors import LocalFault
from scenefold.crypto.drafts import sync_folder
from scenefold.store.folder import FolderLock
from scenefold.store.lmdb_transaction import LmdbTransaction
from scenefold.store.passage import Passage
from scenefold.store.preallocation import NO_ROOM, GrowingFile
from scenefold.store.sealing import WIPE, damaged
from scenefold.world.ports import DiskFailed, DiskFull, DiskSpace, ReadTransaction, WriteTransaction

T = TypeVar("T")

DATA_NAME = "data.mdb"
NEW_NAME = "data.new"
"""As long as a folder's first file is being made. Nothing is in it, and a crash leaves it to the next start."""
MAP_BYTES_FIRST = 64 * 1024 * 1024
MAP_BYTES_MAX = 1 << 46
CUT_BYTES_MAX = 1 << 20
"""A file may be so much shorter than it says: pages that a commit on a full disk took and gave back are never written."""
READERS_MAX = 126


class LmdbDisk:
    """Opens folders as LMDB environments."""

    def __init__(self, *, map_bytes_first: int = MAP_BYTES_FIRST, ahead_bytes_max: int = 0) -> None:
        """`ahead_bytes_max`: how far a file is lengthened before there is need."""
        self._map_bytes_first = map_bytes_first
        self._ahead_bytes_max = ahead_bytes_max

    def open(self, folder: Path, tables: Sequence[str]) -> LmdbEnvironment:
        lock = FolderLock(folder)
        try:
            return LmdbEnvironment(folder, tables, lock, self._map_bytes_first, self._ahead_bytes_max)
        except BaseException:
            lock.release()
            raise


class LmdbEnvironment:
    """An open folder (port `Environment`)."""

    def __init__(self, folder: Path, tables: Sequence[str], lock: FolderLock, map_bytes: int, ahead_bytes_max: int) -> None:
        self._folder = folder
        self._names = tuple(tables)
        self._lock = lock
        self._passage = Passage()
        self._ahead_bytes_max = ahead_bytes_max
        # A map twice the file leaves room for the first changes after a start; what was taken ahead is none of it.
        self._map_bytes = max(map_bytes, 2 * (_file_bytes(folder) - ahead_bytes_max))
        self._failed: str | None = None
        try:
            _make(folder)
            self._open()
        except lmdb.Error as error:
            raise opening_fault(error, folder) from error
        except OSError as error:
            remedy = "see to the disk, and to how many files this process may open"
            raise LocalFault(f"{DATA_NAME} there cannot be opened: {error}", where=str(folder), remedy=remedy) from error
        self._reach_ahead()

    def _open(self) -> None:
        env = lmdb.open(
            str(self._folder),
            map_size=self._map_bytes,
            max_dbs=len(self._names) + 8,
            max_readers=READERS_MAX,
            mode=0o600,
            create=True,
        )
        try:
            check_length(env, self._folder)
            self._tables = {name: env.open_db(name.encode()) for name in self._names}
            # The machine that made the folder may have had pages of another size.
            self._page_bytes = int(env.stat()["psize"])
            self._file = GrowingFile(self._folder / DATA_NAME, self._ahead_bytes_max)
        except BaseException:
            env.close()
            raise
        self._env = env

    def _reach_ahead(self) -> None:
        try:
            self._file.reach(self._end_bytes())
        except OSError as error:
            self._shut()
            remedy = "see to the disk"
            raise LocalFault(f"the store's file cannot be lengthened: {error}", where=str(self._folder), remedy=remedy) from error

    @contextmanager
    def read(self) -> Iterator[ReadTransaction]:
        with self._passage.shared(), self._env.begin(buffers=True) as transaction:
            try:
                yield LmdbTransaction(transaction, self._tables, self._page_bytes)
            except lmdb.Error as error:
                raise damaged(f"the tree in {DATA_NAME} cannot be read: {error}") from error

    def update(self, change: Callable[[WriteTransaction], T]) -> T:
        while True:
            if self._failed is not None:
                raise DiskFailed(self._failed)
            try:
                return self._commit(change)
            except lmdb.MapFullError:
                self._grow()

    def _commit(self, change: Callable[[WriteTransaction], T]) -> T:
        with self._passage.shared():
            enough = True
            try:
                with self._env.begin(write=True, buffers=True) as transaction:
                    ours = LmdbTransaction(transaction, self._tables, self._page_bytes)
                    result = change(ours)
                    try:
                        enough = self._file.reach(self._end_bytes() + ours.dirty_bytes_max)
                    except OSError as error:
                        raise self._fail(error) from error
                return result
            except lmdb.MapFullError:
                raise
            except lmdb.Error as error:
                raise self._why(error, enough) from error

    def _end_bytes(self) -> int:
        return (int(self._env.info()["last_pgno"]) + 1) * self._page_bytes

    def _why(self, error: lmdb.Error, enough: bool) -> Exception:
        # LMDB reports a write that was cut short as an input/output error; where the file could not be lengthened
        # before, we know better.
        code = getattr(error, "code", 0)
        if code in NO_ROOM or (code == errno.EIO and not enough):
            return DiskFull(f"no room on the disk of {self._folder}")
        # After a failed sync the kernel may have dropped the pages, and the next sync would wrongly succeed. So
        # nothing is written from here on; what was acknowledged before is on the disk.
        return self._fail(error)

    def _fail(self, error: Exception) -> DiskFailed:
        self._failed = f"the disk of {self._folder} failed: {error}"
        return DiskFailed(self._failed)

    def _grow(self) -> None:
        if self._map_bytes * 2 > MAP_BYTES_MAX:
            raise DiskFull(f"the store in {self._folder} has reached its greatest size")
        with self._passage.alone():
            self._shut()
            smaller, self._map_bytes = self._map_bytes, self._map_bytes * 2
            try:
                self._open()
            except (lmdb.Error, OSError) as error:
                self._map_bytes = smaller
                try:
                    self._open()
                except (lmdb.Error, OSError) as worse:
                    raise self._fail(worse) from worse
                raise DiskFull(f"no room in memory for a map of {2 * smaller} bytes of {self._folder}") from error

    def space(self) -> DiskSpace:
        """From the tables' page counts and the file system; touches no data."""
        with self._passage.shared():
            with self._env.begin() as transaction:
                stats = [transaction.stat(table) for table in self._tables.values()]
            live = sum(int(s["branch_pages"] + s["leaf_pages"] + s["overflow_pages"]) for s in stats) * self._page_bytes
            file_bytes = self._file.size
        files = os.statvfs(self._folder)
        return DiskSpace(
            used=live,
            reusable=max(0, file_bytes - live),
            free=files.f_bavail * files.f_frsize,
            total=files.f_blocks * files.f_frsize,
        )

    def _shut(self) -> None:
        self._file.close()
        self._env.close()

    def close(self) -> None:
        with self._passage.alone():
            self._failed = f"the store in {self._folder} is closed"
            self._shut()
            self._lock.release()


def _file_bytes(folder: Path) -> int:
    path = folder / DATA_NAME
    return path.stat().st_size if path.exists() else 0


def _make(folder: Path) -> None:
    """The first file of a folder, whole and durable, or none."""
    path, new = folder / DATA_NAME, folder / NEW_NAME
    if path.exists():
        check_begun(path)
        return
    new.unlink(missing_ok=True)
    try:
        with lmdb.open(str(new), subdir=False, lock=False, mode=0o600) as env:
            env.sync(True)
        new.rename(path)
    except BaseException:
        new.unlink(missing_ok=True)
        raise
    sync_folder(folder)


def check_begun(path: Path) -> None:
    """LocalFault if the file is empty. LMDB would take that for a new store, and everything that was in it would be gone in silence."""
    if not path.stat().st_size:
        raise _no_store(path.parent)


def check_length(env: lmdb.Environment, folder: Path) -> None:
    """LocalFault if the file has been cut off. Whoever read a page behind its end would be ended by the kernel."""
    told = (int(env.info()["last_pgno"]) + 1) * int(env.stat()["psize"])
    if _file_bytes(folder) + CUT_BYTES_MAX < told:
        what = f"{DATA_NAME} there is cut off: {_file_bytes(folder)} bytes of {told}"
        raise LocalFault(what, where=str(folder), remedy=WIPE)


def opening_fault(error: lmdb.Error, folder: Path) -> LocalFault:
    if getattr(error, "code", 0) in NO_ROOM:
        return LocalFault("the disk of the data folder is full", where=str(folder), remedy="free some space there")
    if isinstance(error, lmdb.ReadonlyError):
        remedy = "give this user write permission, or choose another folder"
        return LocalFault("the data folder cannot be written", where=str(folder), remedy=remedy)
    if isinstance(error, lmdb.InvalidError | lmdb.CorruptedError | lmdb.VersionMismatchError):
        return _no_store(folder)
    return LocalFault(f"the store cannot be opened: {error}", where=str(folder), remedy="choose another folder")


def _no_store(folder: Path) -> LocalFault:
    return LocalFault(f"{DATA_NAME} there is damaged, or no store", where=str(folder), remedy=WIPE)
