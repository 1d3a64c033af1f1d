"""If this failed, a node could take another node's data for its own, or two processes could write one folder."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.base.ids import node_id_of
from scenefold.store import LmdbDisk, StoreIdentity, open_store
from scenefold.store.folder import LOCK_NAME
from scenefold.store.identity import FORMAT_VERSION
from scenefold.store.layout import HOLDING, IDENTITY, NOTES, RECORDS, TABLES
from scenefold.store.lmdb_disk import DATA_NAME, NEW_NAME
from scenefold.store.sealing import sealed
from scenefold.world import WriteTransaction
from unit.store.samples import NODE, put, whole_store, world


async def identity_of(folder: Path) -> StoreIdentity:
    async with whole_store(world(), folder) as store:
        return store.identity


async def fault(folder: Path, remedy: str = "", node: int = NODE) -> str:
    with pytest.raises(LocalFault) as caught:
        async with open_store(world(), folder, node_id_of("127.0.0.3") if node != NODE else NODE):
            pass
    assert caught.value.where == str(folder)
    assert caught.value.remedy and remedy in caught.value.remedy
    return caught.value.what


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


async def test_the_incarnation_stays_and_the_boot_counter_rises(tmp_path: Path) -> None:
    first, second = await identity_of(tmp_path / "a"), await identity_of(tmp_path / "a")
    other = await identity_of(tmp_path / "b")
    assert (first.boot, second.boot, other.boot) == (1, 2, 1)
    assert first.incarnation == second.incarnation != other.incarnation
    assert len(first.incarnation) == 16


async def test_the_folder_of_another_node(tmp_path: Path) -> None:
    await identity_of(tmp_path)
    assert "belongs to node 127.0.0.2, not to 127.0.0.3" in await fault(tmp_path, node=0)
    assert (await identity_of(tmp_path)).boot == 2


async def test_a_newer_format(tmp_path: Path) -> None:
    await identity_of(tmp_path)
    environment = LmdbDisk().open(tmp_path, TABLES)
    newer = sealed(IDENTITY, b"format", (FORMAT_VERSION + 1).to_bytes(4, "big"))
    environment.update(lambda transaction: transaction.put(IDENTITY, b"format", newer))
    environment.close()
    assert "newer scenefold" in await fault(tmp_path)


async def test_a_damaged_identity(tmp_path: Path) -> None:
    await identity_of(tmp_path)
    environment = LmdbDisk().open(tmp_path, TABLES)
    environment.update(lambda transaction: transaction.put(IDENTITY, b"boot", sealed(IDENTITY, b"boot", b"?")))
    environment.close()
    assert await fault(tmp_path) == "the store's 'boot' is damaged"


@pytest.mark.parametrize("left", [RECORDS, IDENTITY, HOLDING, NOTES])
async def test_data_without_an_identity(tmp_path: Path, left: str) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
        await store.put_note("a", b"note")

    def forget(transaction: WriteTransaction) -> None:
        for table in (RECORDS, IDENTITY, HOLDING, NOTES):
            for key in list(transaction.keys(table, b"", b"\xff" * 64)):
                if table != left or key == b"format":
                    transaction.delete(table, key)

    environment = LmdbDisk().open(tmp_path, TABLES)
    environment.update(forget)
    environment.close()
    assert await fault(tmp_path) == f"the store has {left} but no identity"


async def test_a_folder_in_use_here(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path):
        assert f"in use by process {os.getpid()}" in await fault(tmp_path)
    await identity_of(tmp_path)


@contextmanager
def process_that_locks(folder: Path) -> Iterator[int]:
    """Another process holds the lock of the folder; at the end it is killed."""
    script = f"""
import sys
from pathlib import Path
from scenefold.store.folder import FolderLock
lock = FolderLock(Path({str(folder)!r}))
print("locked", flush=True)
sys.stdin.read()
"""
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"locked\n"
        yield holder.pid
        holder.kill()


async def test_a_folder_in_use_by_another_process_and_then_left_by_a_dead_one(tmp_path: Path) -> None:
    with process_that_locks(tmp_path) as pid:
        assert f"in use by process {pid}" in await fault(tmp_path)
    assert (tmp_path / LOCK_NAME).read_text() == f"{pid}\n"
    assert (await identity_of(tmp_path)).boot == 1


async def test_a_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    assert await fault(tmp_path / "file") == "the data folder is a file"
    assert await fault(tmp_path / "file" / "below") == "the data folder is a file"


async def test_data_that_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "data.mdb").write_bytes(b"a picture, perhaps" * 1000)
    assert "damaged, or no store" in await fault(tmp_path, "wipe the folder")


async def test_data_that_is_empty_is_not_begun_anew(tmp_path: Path) -> None:
    await identity_of(tmp_path)
    os.truncate(tmp_path / DATA_NAME, 0)
    assert "damaged, or no store" in await fault(tmp_path, "wipe the folder")
    assert not (tmp_path / DATA_NAME).stat().st_size


@pytest.mark.parametrize("left", [b"", b"half of a page"])
async def test_a_crash_while_the_folder_is_made_leaves_one_that_starts(tmp_path: Path, left: bytes) -> None:
    (tmp_path / NEW_NAME).write_bytes(left)
    assert (await identity_of(tmp_path)).boot == 1
    assert names_in(tmp_path) == {DATA_NAME, "lock.mdb", LOCK_NAME}


async def test_the_first_file_has_its_name_once_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(path: Path, _target: Path) -> Path:
        assert path.stat().st_size and not (tmp_path / DATA_NAME).exists()
        raise OSError(5, "no more power")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", crash)
        assert "cannot be opened" in await fault(tmp_path, "see to the disk")
    assert (await identity_of(tmp_path)).boot == 1


@contextmanager
def folder_that_cannot_be_written() -> Iterator[Path]:
    """Root may write everywhere, so meanwhile we are nobody."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o555)
        before = os.geteuid()
        os.seteuid(65534 if before == 0 else before)
        try:
            yield Path(name)
        finally:
            os.seteuid(before)
            Path(name).chmod(0o755)


async def test_a_folder_that_cannot_be_written() -> None:
    with folder_that_cannot_be_written() as folder:
        assert await fault(folder) == "the data folder cannot be written"
