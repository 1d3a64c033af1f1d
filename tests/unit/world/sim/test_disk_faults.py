"""If this failed, a broken disk would look whole in a simulation, or a whole one broken."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from scenefold.base.errors import LocalFault
from scenefold.world import DiskFailed, DiskFull, Environment
from scenefold.world.sim import SimDisk

FOLDER = Path("data")


def opened(disk: SimDisk) -> Environment:
    return disk.open(FOLDER, ("rows",))


def put(environment: Environment, key: bytes, value: bytes = b"value") -> None:
    environment.update(lambda rows: rows.put("rows", key, value))


def rows(environment: Environment) -> dict[bytes, bytes]:
    with environment.read() as view:
        return {key: bytes(value) for key, value in view.scan("rows", b"", b"\xff")}


def test_a_crash_keeps_what_was_committed_and_releases_the_folder() -> None:
    disk = SimDisk()
    before = opened(disk)
    put(before, b"1")
    disk.crash(torn=True)
    with pytest.raises(DiskFailed, match="crashed"):
        put(before, b"2")
    after = opened(disk)
    before.close()
    assert rows(after) == {b"1": b"value"}
    with pytest.raises(LocalFault, match="in use"):
        opened(disk)


def test_a_disk_that_lies_loses_its_last_commit_whole_in_a_torn_crash() -> None:
    disk = SimDisk()
    environment = opened(disk)
    put(environment, b"1", b"old")

    def several(view: object) -> None:
        view.put("rows", b"1", b"new")  # type: ignore[attr-defined]
        view.put("rows", b"2", b"new")  # type: ignore[attr-defined]

    environment.update(several)
    disk.lies = True
    disk.crash()
    assert rows(opened(disk)) == {b"1": b"new", b"2": b"new"}
    disk.crash()
    environment = opened(disk)
    environment.update(lambda view: [view.delete("rows", b"1"), view.put("rows", b"3", b"x")])
    disk.crash(torn=True)
    assert rows(opened(disk)) == {b"1": b"new", b"2": b"new"}


def test_a_full_disk_takes_nothing_of_a_change_and_reuses_what_was_freed() -> None:
    disk = SimDisk()
    environment = opened(disk)
    put(environment, b"1", bytes(1000))
    disk.fill(500)
    with pytest.raises(DiskFull):
        environment.update(lambda view: [view.put("rows", b"0", b"x"), view.put("rows", b"2", bytes(1000))])
    assert rows(environment) == {b"1": bytes(1000)}
    environment.update(lambda view: view.delete("rows", b"1"))
    assert environment.space().reusable > 1000
    put(environment, b"2", bytes(1000))
    put(environment, b"3", bytes(400))
    assert environment.space().free < 100
    disk.fill(None)
    put(environment, b"4", bytes(10_000))


def test_a_disk_without_a_free_byte_takes_no_change_though_it_only_deletes() -> None:
    disk = SimDisk()
    environment = opened(disk)
    put(environment, b"1", bytes(1000))
    put(environment, b"2", bytes(1000))
    environment.update(lambda view: view.delete("rows", b"2"))
    disk.fill(0)
    with pytest.raises(DiskFull):
        environment.update(lambda view: view.delete("rows", b"1"))
    with pytest.raises(DiskFull):
        put(environment, b"1", b"x")
    assert rows(environment) == {b"1": bytes(1000)}
    environment.update(lambda view: view.get("rows", b"1"))
    disk.fill(1)
    environment.update(lambda view: view.delete("rows", b"1"))
    assert rows(environment) == {}


def test_a_damaged_value_differs_in_one_bit() -> None:
    disk = SimDisk()
    environment = opened(disk)
    for number in range(10):
        put(environment, b"%d" % number, bytes(100))
    assert disk.corrupt("nothing", Random(1)) is None
    assert disk.corrupt("rows", Random(1), b"4") == b"4"
    victim = disk.corrupt("rows", Random(1))
    damaged = {key for key, value in rows(environment).items() if value != bytes(100)}
    assert damaged == {b"4", victim}
    assert sum(rows(environment)[b"4"]).bit_count() == 1


def test_a_new_disk_is_empty() -> None:
    disk = SimDisk()
    put(opened(disk), b"1")
    disk.wipe()
    assert rows(opened(disk)) == {}


def test_a_backup_brings_the_past_back_and_may_be_used_again() -> None:
    disk = SimDisk()
    environment = opened(disk)
    put(environment, b"1")
    backup = disk.snapshot()
    put(environment, b"2")
    for _ in range(2):
        disk.restore(backup)
        environment = opened(disk)
        assert rows(environment) == {b"1": b"value"}
        put(environment, b"3")


def test_values_are_not_used_after_their_transaction_or_a_change() -> None:
    environment = opened(SimDisk())
    put(environment, b"1")
    with environment.read() as view:
        value = view.get("rows", b"1")
    assert value is not None
    with pytest.raises(ValueError, match="released"):
        bytes(value)
    with pytest.raises(AssertionError, match="after its end"):
        view.get("rows", b"1")

    def change(writing: object) -> bytes:
        old = writing.get("rows", b"1")  # type: ignore[attr-defined]
        writing.put("rows", b"2", b"x")  # type: ignore[attr-defined]
        return bytes(old)

    with pytest.raises(ValueError, match="released"):
        environment.update(change)


def test_what_has_rotted_is_known_as_it_was_written_until_it_is_written_anew() -> None:
    disk = SimDisk()
    environment = opened(disk)
    put(environment, b"1", b"first")
    put(environment, b"2", b"other")
    assert disk.rotten("rows") == {} and disk.written("rows") == disk.peek("rows")
    for bit in (1, 2, 3):
        disk.corrupt("rows", Random(bit), b"1")
        assert disk.rotten("rows") == {b"1": b"first"}
        assert dict(disk.written("rows")) == {b"1": b"first", b"2": b"other"} != dict(disk.peek("rows"))
    backup = disk.snapshot()
    put(environment, b"1", b"second")
    twice = Random(1), Random(1)
    for same_bit in twice:
        disk.corrupt("rows", same_bit, b"2")
    assert disk.rotten("rows") == {} and disk.written("rows")[b"1"] == b"second"
    disk.restore(backup)
    assert disk.rotten("rows") == {b"1": b"first"}
    disk.wipe()
    assert disk.rotten("rows") == {}
