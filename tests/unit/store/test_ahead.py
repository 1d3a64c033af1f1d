"""If this fails, others who fill the disk take the room that a store needs to delete; or a store takes a small disk for itself."""

from __future__ import annotations

import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from scenefold.base.limits import STORE_RESERVE_BYTES
from scenefold.store import LmdbDisk
from scenefold.store.layout import RECORDS
from scenefold.store.lmdb_disk import DATA_NAME
from scenefold.store.preallocation import AHEAD_BYTES_MIN, STEP_BYTES_MIN, GrowingFile
from scenefold.world import DiskFull, Environment, WriteTransaction

MIB = 1 << 20
AHEAD = 32 * MIB


class Small(GrowingFile):
    """On a disk with so many bytes free."""

    free = 0

    def _free_bytes(self) -> int:
        return self.free


def small(folder: Path, free: int) -> Small:
    (folder / "file").touch()
    file = Small(folder / "file", AHEAD)
    file.free = free
    return file


@pytest.mark.parametrize(
    ("size", "free", "reached"),
    [
        (MIB, 1 << 40, MIB + AHEAD_BYTES_MIN + STEP_BYTES_MIN),
        (16 * MIB, 1 << 40, 34 * MIB),
        (80 * MIB, 1 << 40, 122 * MIB),
        (MIB, AHEAD + 5 * MIB, 5 * MIB),
        (MIB, AHEAD, 2 * MIB),
        (MIB, 0, 2 * MIB),
    ],
)
def test_a_file_takes_as_much_ahead_as_it_has_and_leaves_as_much_to_others(tmp_path: Path, size: int, free: int, reached: int) -> None:
    file = small(tmp_path, free)
    assert file.reach(size)
    assert file.size == (tmp_path / "file").stat().st_size == reached
    file.close()


def test_who_has_what_it_needs_is_not_lengthened_on_a_full_disk(tmp_path: Path) -> None:
    file = small(tmp_path, AHEAD)
    file.reach(MIB)
    before = file.size
    assert file.reach(before)
    assert file.size == before
    file.close()


@contextmanager
def others_have_the_rest(folder: Path) -> Iterator[None]:
    """No file of this process grows beyond what the store's has: to it, a disk without a free byte."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ((folder / DATA_NAME).stat().st_size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def stored(environment: Environment, count: int) -> None:
    def fill(transaction: WriteTransaction) -> None:
        for number in range(count):
            transaction.put(RECORDS, b"%04d" % number, bytes(60_000))

    environment.update(fill)


def test_others_who_fill_the_disk_leave_room_to_replace_all_there_is_while_somebody_reads(tmp_path: Path) -> None:
    """All of it in one transaction, and no page of before may be written on: no store needs more to delete what it has."""
    environment = LmdbDisk(ahead_bytes_max=STORE_RESERVE_BYTES).open(tmp_path, [RECORDS])
    stored(environment, 100)
    with others_have_the_rest(tmp_path):
        with environment.read() as transaction:
            stored(environment, 100)
            value = transaction.get(RECORDS, b"0000")
            assert value is not None
            assert bytes(value) == bytes(60_000)
        with pytest.raises(DiskFull):
            stored(environment, 1_000)
        stored(environment, 100)
    environment.close()


def test_what_was_taken_ahead_is_room_of_the_store_and_no_data(tmp_path: Path) -> None:
    plain = LmdbDisk().open(tmp_path / "plain", [RECORDS])
    environment = LmdbDisk(ahead_bytes_max=STORE_RESERVE_BYTES).open(tmp_path / "ahead", [RECORDS])
    for one in (plain, environment):
        stored(one, 10)
    assert environment.space().used == plain.space().used
    assert environment.space().reusable >= plain.space().reusable + AHEAD_BYTES_MIN - STEP_BYTES_MIN
    assert (tmp_path / "ahead" / DATA_NAME).stat().st_blocks * 512 >= AHEAD_BYTES_MIN
    environment.close()
    again = LmdbDisk(ahead_bytes_max=STORE_RESERVE_BYTES).open(tmp_path / "ahead", [RECORDS])
    stored(again, 20)
    again.close()
    plain.close()
