"""If one failed, a node in one world would go on where the same node in the other stops, or would lose what it acknowledged."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from conformance.world.makers import DESCRIPTORS, RealWorlds, Worlds
from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.store import open_store
from scenefold.world import DiskFailed, DiskFull, Environment, WriteTransaction

TABLES = ("rows",)
VALUE = bytes(60_000)
MANY = 200
"""Values that do not fit into what a file has in reserve."""


@pytest.fixture(autouse=True)
def _needs_descriptors(request: pytest.FixtureRequest, worlds: Worlds) -> None:
    if isinstance(worlds, RealWorlds) and "failing" in request.node.name and not DESCRIPTORS.exists():
        pytest.skip("only where the system lists the open files of a process can one be broken beneath its holder")


def put(environment: Environment, *keys: bytes, value: bytes = b"value") -> None:
    def change(transaction: WriteTransaction) -> None:
        for key in keys:
            transaction.put("rows", key, value)

    environment.update(change)


def keys(environment: Environment) -> list[bytes]:
    with environment.read() as transaction:
        return list(transaction.keys("rows", b"", b"\xff"))


def fill_up(environment: Environment) -> list[bytes]:
    """Put two rows at a time until there is no room; the keys of those that were taken."""
    taken: list[bytes] = []
    for number in range(MANY):
        pair = [b"%03d-%d" % (number, half) for half in range(2)]
        try:
            put(environment, *pair, value=VALUE)
        except DiskFull:
            return taken
        taken += pair
    raise AssertionError("the disk was never full")


def test_a_full_disk_takes_nothing_of_a_change_and_keeps_all_before(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    put(environment, b"first")
    with worlds.full(0, tmp_path):
        taken = fill_up(environment)
        assert keys(environment) == [*taken, b"first"]
        with pytest.raises(DiskFull, match="no room"):
            put(environment, b"small", b"zlarge", value=VALUE)
        assert keys(environment) == [*taken, b"first"]
    environment.close()
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    assert keys(environment) == [*taken, b"first"]
    environment.close()


def test_a_disk_that_has_room_again_takes_changes_again(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    put(environment, b"first")
    with worlds.full(0, tmp_path):
        fill_up(environment)
    put(environment, b"last", value=VALUE)
    assert b"last" in keys(environment)
    environment.close()


def test_what_is_deleted_makes_room_on_a_full_disk(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    old = [b"%02d" % number for number in range(20)]
    put(environment, *old, value=VALUE)
    with worlds.full(0, tmp_path):
        taken = fill_up(environment)
        environment.update(lambda transaction: [transaction.delete("rows", key) for key in old])
        # A store of pages gives freed pages out with the change after the next.
        environment.update(lambda transaction: None)
        put(environment, b"new", value=VALUE)
        assert keys(environment) == [*taken, b"new"]
    environment.close()


def test_no_folder_begins_on_a_full_disk_and_none_is_left_in_use(worlds: Worlds, tmp_path: Path) -> None:
    disk = worlds.node(0).disk

    def begin() -> None:
        environment = disk.open(tmp_path, TABLES)
        try:
            put(environment, b"first", value=VALUE)
        finally:
            environment.close()

    # A world may need room for an empty folder, or only for its first change.
    with worlds.full(0, tmp_path), pytest.raises((LocalFault, DiskFull), match=r"full|no room"):
        begin()
    environment = disk.open(tmp_path, TABLES)
    put(environment, b"first", value=VALUE)
    environment.close()


def test_a_failing_disk_takes_no_change_any_more_even_if_it_seems_well_again(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    put(environment, b"first")
    with worlds.failing(0, tmp_path):
        with pytest.raises(DiskFailed, match="failed"):
            put(environment, b"second")
        assert b"first" in keys(environment), "what was durable can be read"
    with pytest.raises(DiskFailed, match="failed"):
        put(environment, b"third")
    environment.close()
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    found = keys(environment)
    assert b"first" in found and b"third" not in found, "of the second nobody can tell"
    put(environment, b"fourth")
    environment.close()


def test_the_first_change_on_a_failing_disk_fails_too(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    # The file is as short as can be: before anything is written it has to be lengthened.
    with worlds.failing(0, tmp_path), pytest.raises(DiskFailed, match="failed"):
        put(environment, b"first", value=VALUE)
    environment.close()
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    assert keys(environment) == []
    environment.close()


# ---------------------------------------------------------------------------------------------- what people are told


async def test_who_starts_on_a_full_disk_is_told_to_free_some_space(worlds: Worlds, tmp_path: Path) -> None:
    world = worlds.node(0)
    with worlds.full(0, tmp_path), pytest.raises(LocalFault, match=r"full|no room") as fault:
        async with open_store(world, tmp_path, NodeId(1)):
            pass
    assert str(fault.value.where) == str(tmp_path) and str(fault.value.remedy).startswith("free some space")
    async with open_store(world, tmp_path, NodeId(1)):
        pass


async def test_who_opens_a_folder_of_another_node_is_told_whose_it_is(worlds: Worlds, tmp_path: Path) -> None:
    world = worlds.node(0)
    async with open_store(world, tmp_path, NodeId(0x0A000001)):
        with pytest.raises(LocalFault, match="in use") as held:
            async with open_store(worlds.node(0), tmp_path, NodeId(0x0A000001)):
                pass
        assert str(held.value.remedy).startswith("stop that process")
    with pytest.raises(LocalFault, match=r"belongs to node 10\.0\.0\.1, not to 10\.0\.0\.2") as strange:
        async with open_store(world, tmp_path, NodeId(0x0A000002)):
            pass
    assert strange.value.remedy == "give each node a data folder of its own"


@pytest.mark.expect_log("failed")
async def test_a_failing_disk_ends_the_store_and_says_what_to_do(worlds: Worlds, tmp_path: Path) -> None:
    world = worlds.node(0)

    async def use() -> None:
        async with open_store(world, tmp_path, NodeId(1)) as store:
            with worlds.failing(0, tmp_path), pytest.raises(Refused):
                await store.put_holding(None, b"note")
            await trio.sleep_forever()

    with trio.fail_after(30), pytest.raises(LocalFault, match="failed") as fault:
        await use()
    assert fault.value.remedy == "see to the disk, then start the node again"
