"""If this fails, a map that cannot be enlarged ends a node without a word of why, or writes go on beside a closed file."""

from __future__ import annotations

import errno
from pathlib import Path

import lmdb
import pytest

from scenefold.base.errors import LocalFault
from scenefold.store import LmdbDisk, lmdb_disk
from scenefold.store.layout import RECORDS
from scenefold.store.lmdb_disk import LmdbEnvironment
from scenefold.world import DiskFailed, DiskFull, WriteTransaction


def fill(transaction: WriteTransaction) -> None:
    for number in range(100):
        transaction.put(RECORDS, number.to_bytes(4, "big"), bytes(10_000))


def mark(transaction: WriteTransaction) -> None:
    transaction.put(RECORDS, b"small", b"change")


@pytest.mark.parametrize("failures", [1, 2])
def test_without_memory_for_a_larger_map_the_old_one_stays_or_the_disk_has_failed(
    failures: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = LmdbDisk(map_bytes_first=1 << 18).open(tmp_path, [RECORDS])
    opens, left = LmdbEnvironment._open, failures

    def no_memory(self: LmdbEnvironment) -> None:
        nonlocal left
        if left:
            left -= 1
            raise lmdb.MemoryError("Cannot allocate memory")
        opens(self)

    with monkeypatch.context() as patched:
        patched.setattr(LmdbEnvironment, "_open", no_memory)
        with pytest.raises(DiskFull if failures == 1 else DiskFailed, match="memory"):
            disk.update(fill)
    if failures == 1:
        disk.update(mark)
    else:
        with pytest.raises(DiskFailed, match="memory"):
            disk.update(mark)
    disk.close()
    again = LmdbDisk().open(tmp_path, [RECORDS])
    with again.read() as transaction:
        assert transaction.get(RECORDS, b"small") == (b"change" if failures == 1 else None)
    again.close()


def test_a_file_that_cannot_be_held_open_leaves_nothing_open_and_nothing_locked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_files(path: Path, ahead_bytes_max: int = 0) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr(lmdb_disk, "GrowingFile", no_files)
        with pytest.raises(LocalFault, match=r"cannot be opened: .*Too many open files"):
            LmdbDisk().open(tmp_path, [RECORDS])
    disk = LmdbDisk().open(tmp_path, [RECORDS])
    disk.update(mark)
    disk.close()
