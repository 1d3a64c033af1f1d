"""If this failed, who looks at a damaged disk would change it, be ended by the kernel, or look at what another process is writing."""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.store import LmdbDisk, StoreDamaged, open_store
from scenefold.store.checking import check_store
from scenefold.store.folder import LOCK_NAME, FolderLock
from scenefold.store.layout import RECORDS, STATISTICS, TABLES
from scenefold.store.lmdb_disk import CUT_BYTES_MAX, DATA_NAME
from scenefold.store.lmdb_pages import PagesDamaged
from scenefold.store.lmdb_reading import looked_at
from unit.store.samples import NODE, place, put, whole_store, world
from unit.store.test_folder import process_that_locks

PAGE = 4096


async def filled(folder: Path, count: int = 20, size: int = 64) -> None:
    async with whole_store(world(), folder) as store:
        for start in range(0, count, 20):
            await store.put([put(number, size=size) for number in range(start, min(count, start + 20))])


def hashes(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.name != LOCK_NAME}


async def test_a_look_changes_nothing(tmp_path: Path) -> None:
    await filled(tmp_path)
    before = hashes(tmp_path)
    (tmp_path / LOCK_NAME).write_text("1234\n")
    os.utime(tmp_path / LOCK_NAME, ns=(10**18, 10**18))
    with looked_at(tmp_path, TABLES) as view:
        found = check_store(view)
        assert (tmp_path / LOCK_NAME).read_text() == f"{os.getpid()}\n"
    assert found.is_sound and found.records.records == 20
    assert hashes(tmp_path) == before
    assert (tmp_path / LOCK_NAME).read_text() == "1234\n", "as its last node left it"
    assert (tmp_path / LOCK_NAME).stat().st_mtime_ns == 10**18
    (tmp_path / LOCK_NAME).unlink()
    with looked_at(tmp_path, TABLES):
        assert (tmp_path / LOCK_NAME).exists()
    assert not (tmp_path / LOCK_NAME).exists()
    async with open_store(world(), tmp_path, NODE) as store:
        assert store.identity.boot == 2


async def test_a_folder_that_is_in_use_is_left_alone_and_so_is_one_that_is_looked_at(tmp_path: Path) -> None:
    await filled(tmp_path)
    with process_that_locks(tmp_path) as pid, pytest.raises(LocalFault, match=f"in use by process {pid}"), looked_at(tmp_path, TABLES):
        pass
    with looked_at(tmp_path, TABLES), pytest.raises(LocalFault, match=f"in use by process {os.getpid()}"):
        LmdbDisk().open(tmp_path, TABLES)
    LmdbDisk().open(tmp_path, TABLES).close()


async def test_who_waits_at_a_lock_file_that_is_removed_locks_the_folder_s_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else two processes would each lock a file of that name."""
    await filled(tmp_path)
    (tmp_path / LOCK_NAME).unlink()
    first = FolderLock(tmp_path, only_read=True)
    lock, opened = fcntl.flock, list[int]()

    def removed_between(file: int, how: int) -> None:
        opened.append(file)
        if len(opened) == 1:
            first.release()
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", removed_between)
    second = FolderLock(tmp_path)
    assert len(opened) == 2, "the first was of a file that is gone"
    with pytest.raises(LocalFault, match=f"in use by process {os.getpid()}"):
        FolderLock(tmp_path)
    second.release()


@contextmanager
def only_readable(folder: Path) -> Iterator[None]:
    """Nothing in the folder can be written, and no lock file is there. Root may write everywhere, so meanwhile we are nobody."""
    (folder / LOCK_NAME).unlink()
    for path in (folder, *folder.iterdir()):
        path.chmod(0o555 if path.is_dir() else 0o444)
    before = os.geteuid()
    os.seteuid(65534 if before == 0 else before)
    try:
        yield
    finally:
        os.seteuid(before)
        folder.chmod(0o755)


async def test_a_disk_that_is_read_only_can_be_looked_at() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        await filled(folder)
        with only_readable(folder), looked_at(folder, TABLES) as view:
            assert check_store(view).is_sound
        assert not (folder / LOCK_NAME).exists()


@pytest.mark.parametrize("what", ["nothing", "a file", "an empty folder", "a picture", "an empty file", "another store"])
async def test_where_no_store_is(tmp_path: Path, what: str) -> None:
    folder = tmp_path / "there"
    if what == "a file":
        folder.write_text("x")
    elif what != "nothing":
        folder.mkdir()
    if what == "a picture":
        (folder / DATA_NAME).write_bytes(b"a picture, perhaps" * 1000)
    if what == "an empty file":
        (folder / DATA_NAME).write_bytes(b"")
    if what == "another store":
        LmdbDisk().open(folder, ["of somebody else"]).close()
    damaged = what in ("a picture", "an empty file")
    with (
        pytest.raises(PagesDamaged if damaged else LocalFault, match="is empty" if "empty file" in what else "no store") as fault,
        looked_at(folder, TABLES),
    ):
        pass
    assert isinstance(fault.value, PagesDamaged) == damaged, "what may have been a store is damaged, and no other folder"
    assert not folder.is_dir() or not (folder / LOCK_NAME).exists() or what == "another store"
    assert str(fault.value.where).startswith(str(folder)) and fault.value.remedy
    if what == "nothing":
        assert not folder.exists()


async def test_a_file_that_is_cut_off_is_told_from_one_that_is_whole_and_no_page_behind_its_end_is_touched(tmp_path: Path) -> None:
    await filled(tmp_path, 100, 60_000)
    data = tmp_path / DATA_NAME
    os.truncate(data, data.stat().st_size - 2 * CUT_BYTES_MAX - (1 << 21))
    before = data.stat().st_size
    with pytest.raises(PagesDamaged, match="tree of the store is damaged") as damage, looked_at(tmp_path, TABLES):
        pass
    assert "wipe the folder" in damage.value.remedy and "cut off" in str(damage.value.problems)
    with pytest.raises(LocalFault, match="cut off") as fault:
        async with open_store(world(), tmp_path, NODE):
            pass
    assert fault.value.where == str(tmp_path) and data.stat().st_size == before
    with pytest.raises(LocalFault, match="cut off"):
        LmdbDisk().open(tmp_path, TABLES)


@pytest.mark.expect_log("cannot be read")
async def test_a_tree_that_lmdb_finds_to_be_damaged_ends_the_store_with_words_that_help(tmp_path: Path) -> None:
    await filled(tmp_path, 100, 6_000)
    data = bytearray((tmp_path / DATA_NAME).read_bytes())
    # The roots of the table, as its entry in the tree of tables has them, the present one among them.
    for found in re.finditer(rb"records(.{48})", bytes(data), re.DOTALL):
        root = int.from_bytes(found[1][-8:], "little")
        data[root * PAGE : (root + 1) * PAGE] = bytes(PAGE)
    (tmp_path / DATA_NAME).write_bytes(data)
    with pytest.raises(StoreDamaged, match="cannot be read") as fault:
        async with open_store(world(), tmp_path, NODE) as store:
            await store.get_many([place(1)])
    assert fault.value.where == str(tmp_path) and "wipe the folder" in fault.value.remedy
    with pytest.raises(PagesDamaged, match="records"), looked_at(tmp_path, TABLES):
        pass


async def test_tables_that_an_earlier_version_did_not_have_are_empty(tmp_path: Path) -> None:
    LmdbDisk().open(tmp_path, (RECORDS,)).close()
    with looked_at(tmp_path, TABLES) as view:
        assert check_store(view).is_sound
        assert view.get(STATISTICS, b"x") is None and view.first(STATISTICS, b"", b"\xff") is None


async def test_two_that_look_at_a_folder_without_a_lock_file_that_cannot_be_written() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        await filled(folder)
        with only_readable(folder):
            first = FolderLock(folder, only_read=True)
            with pytest.raises(LocalFault, match="in use by process unknown"):
                FolderLock(folder, only_read=True)
            first.release()
            FolderLock(folder, only_read=True).release()
