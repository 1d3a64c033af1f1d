"""If one failed, a store in one world would go on, or begin, where the same store in the other does not."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from conformance.world.makers import Worlds
from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE
from scenefold.store import Outcome, Store, open_store
from scenefold.store.identity import FORMAT_VERSION
from scenefold.store.layout import IDENTITY, TABLES
from scenefold.store.sealing import sealed
from unit.store.samples import place, put, record

NODE = NodeId(1)
MANY = 200


async def test_puts_that_arrive_during_a_commit_share_the_next_and_each_is_durable_once_it_is_answered(
    worlds: Worlds, tmp_path: Path
) -> None:
    async def one(store: Store, number: int) -> None:
        [result] = await store.put([put(number)])
        assert result.outcome is Outcome.STORED

    async with open_store(worlds.node(0), tmp_path, NODE) as store:
        await store.put_holding(WHOLE_LINE, b"")
        before = store.commits
        await one(store, MANY)
        assert store.commits == before + 1, "alone, it waits for nobody"
        async with trio.open_nursery() as nursery:
            for number in range(MANY):
                nursery.start_soon(one, store, number)
        assert store.commits - before < MANY / 4
    async with open_store(worlds.node(0), tmp_path, NODE) as store:
        assert await store.get_many([place(number) for number in range(MANY + 1)]) == [record(number) for number in range(MANY + 1)]


async def test_one_put_that_cannot_be_does_no_harm_to_those_that_share_its_commit(worlds: Worlds, tmp_path: Path) -> None:
    outcomes: dict[int, Outcome] = {}

    async def one(store: Store, number: int) -> None:
        [result] = await store.put([put(number, expects=b"\1" * 32) if number % 7 == 0 else put(number)])
        outcomes[number] = result.outcome

    async with open_store(worlds.node(0), tmp_path, NODE) as store:
        await store.put_holding(WHOLE_LINE, b"")
        async with trio.open_nursery() as nursery:
            for number in range(70):
                nursery.start_soon(one, store, number)
        assert {number for number, outcome in outcomes.items() if outcome is Outcome.EXISTS} == set(range(0, 70, 7))
        assert (await store.statistics()).records == 60


@pytest.mark.parametrize(("version", "words"), [(FORMAT_VERSION + 1, "newer scenefold"), (1, "earlier scenefold")])
async def test_a_folder_of_another_version_is_refused_and_stays_as_it_is(worlds: Worlds, tmp_path: Path, version: int, words: str) -> None:
    world = worlds.node(0)
    async with open_store(world, tmp_path, NODE) as store:
        await store.put_holding(WHOLE_LINE, b"")
        await store.put([put(1)])
    environment = world.disk.open(tmp_path, TABLES)
    other = sealed(IDENTITY, b"format", version.to_bytes(4, "big"))
    environment.update(lambda transaction: transaction.put(IDENTITY, b"format", other))
    environment.close()
    for _ in range(2):
        with pytest.raises(LocalFault, match=words) as fault:
            async with open_store(world, tmp_path, NODE):
                pass
        assert str(fault.value.where) == str(tmp_path) and fault.value.remedy
    environment = world.disk.open(tmp_path, TABLES)
    environment.update(
        lambda transaction: transaction.put(IDENTITY, b"format", sealed(IDENTITY, b"format", FORMAT_VERSION.to_bytes(4, "big")))
    )
    environment.close()
    async with open_store(world, tmp_path, NODE) as store:
        assert store.identity.boot == 2, "a start that was refused is none"
        assert await store.get_many([place(1)]) == [record(1)]


@pytest.mark.expect_log("failed")
async def test_a_disk_that_turns_read_only_ends_the_node_and_what_was_acknowledged_can_be_read_until_then(
    worlds: Worlds, tmp_path: Path
) -> None:
    async def use() -> None:
        async with open_store(worlds.node(0), tmp_path, NODE) as store:
            await store.put_holding(WHOLE_LINE, b"")
            await store.put([put(1)])
            with worlds.failing(0, tmp_path):
                assert await store.get_many([place(1)]) == [record(1)]
                with pytest.raises(Refused):
                    await store.put([put(2)])
                with trio.CancelScope(shield=True), pytest.raises(Refused):
                    await store.put([put(3)])
            await trio.sleep_forever()

    with trio.fail_after(30), pytest.raises(LocalFault, match="failed") as fault:
        await use()
    assert "see to the disk" in fault.value.remedy
    async with open_store(worlds.node(0), tmp_path, NODE) as store:
        found = await store.get_many([place(1), place(3)])
        assert found == [record(1), None], "of the second nobody can tell"


async def test_who_opens_a_folder_twice_in_one_moment_has_it_once(worlds: Worlds, tmp_path: Path) -> None:
    opened, refused = list[int](), list[str]()
    all_tried = trio.Event()

    async def start(number: int) -> None:
        try:
            async with open_store(worlds.node(0), tmp_path, NODE):
                opened.append(number)
                await all_tried.wait()
        except LocalFault as fault:
            refused.append(fault.what)
            if len(refused) == 4:
                all_tried.set()

    async with trio.open_nursery() as nursery:
        for number in range(5):
            nursery.start_soon(start, number)
    assert len(opened) == 1 and len(refused) == 4 and all("in use" in what for what in refused)
