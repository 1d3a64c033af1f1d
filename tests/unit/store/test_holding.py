"""If this failed, a node would acknowledge records for places that it has given away."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio
import trio.testing

from scenefold.base.errors import Refused
from scenefold.base.location import WHOLE_LINE
from scenefold.base.reasons import RejectReason
from scenefold.store import LmdbDisk, Outcome, PutResult, Store, StoreDamaged, StoredHolding, open_store
from scenefold.store.layout import HOLDING, TABLES
from scenefold.store.sealing import sealed
from scenefold.world import WriteTransaction
from unit.store.samples import NODE, arc, place, put, record, whole_store, world


async def outcomes(store: Store, *numbers: int) -> list[Outcome]:
    return [result.outcome for result in await store.put([put(number) for number in numbers])]


async def test_only_what_lies_in_the_arc_is_stored(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        assert await outcomes(store, 1) == [Outcome.NOT_OWNED]
        await store.put_holding(arc(10, 20), b"")
        expected = [Outcome.NOT_OWNED, Outcome.STORED, Outcome.STORED, Outcome.NOT_OWNED]
        assert await outcomes(store, 9, 10, 20, 21) == expected
        await store.put_holding(None, b"")
        assert await outcomes(store, 10) == [Outcome.NOT_OWNED]
        assert await store.get_many([place(9), place(10)]) == [None, record(10)]
    assert PutResult(Outcome.NOT_OWNED).reason is RejectReason.NOT_MY_LOCATION


async def test_the_holding_survives_the_process(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.holding() is None
        await store.put_holding(arc(1, 2), b"note")
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.holding() == StoredHolding(arc(1, 2), b"note")
        await store.put_holding(None, b"")
        assert await store.holding() == StoredHolding(None, b"")


async def test_of_puts_that_race_with_a_release_none_lands_behind_it(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        stored: list[int] = []
        released = trio.Event()

        async def write(number: int) -> None:
            began_after = released.is_set()
            [outcome] = await outcomes(store, number)
            if outcome is Outcome.STORED:
                assert not began_after
                stored.append(number)

        async with trio.open_nursery() as nursery:
            for number in range(100):
                nursery.start_soon(write, number)
            await store.put_holding(None, b"")
            released.set()
            for number in range(100, 120):
                nursery.start_soon(write, number)
        entries = (await store.manifest(WHOLE_LINE, None, 1000)).entries
        assert sorted(entry.place.location.number for entry in entries) == sorted(stored)


async def test_a_renewed_node_holds_nothing_and_keeps_its_records(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
        await store.put_holding(WHOLE_LINE, b"note", b"what it holds for whom")
        before = store.identity
        after = await store.renew_identity()
        assert after.incarnation != before.incarnation
        assert (after.node, after.boot) == (before.node, before.boot)
        assert await store.holding() is None, "nor any custody: a restored backup answers for nobody"
        assert await outcomes(store, 2) == [Outcome.NOT_OWNED]
        assert await store.get_many([place(1)]) == [record(1)]
    async with open_store(world(), tmp_path, NODE) as store:
        assert (store.identity.incarnation, store.identity.boot) == (after.incarnation, after.boot + 1)


async def test_a_life_that_ends_gives_the_next_incarnation_no_arc(tmp_path: Path) -> None:
    """Its tasks run on until they hear of the renewal: what they write is in one commit with it, or in a later one."""
    refusals: list[Refused] = []

    async def hold_on() -> None:
        with pytest.raises(Refused) as caught:
            await store.put_holding(WHOLE_LINE, b"")
        refusals.append(caught.value)

    async with whole_store(world(), tmp_path) as store:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(store.renew_identity)
            await trio.testing.wait_all_tasks_blocked(0.0)
            nursery.start_soon(hold_on)
        await hold_on()
        assert [refusal.reason for refusal in refusals] == [RejectReason.NOT_READY] * 2
        assert await outcomes(store, 1) == [Outcome.NOT_OWNED]
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.holding() is None
        await store.put_holding(arc(1, 2), b"note")
        assert await store.holding() == StoredHolding(arc(1, 2), b"note")


async def test_a_holding_from_before_it_named_its_incarnation_is_read(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path):
        pass
    environment = LmdbDisk().open(tmp_path, TABLES)
    environment.update(lambda transaction: transaction.delete(HOLDING, OWNER))
    environment.close()
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.holding() == StoredHolding(WHOLE_LINE, b"")


ARC, NOTE, OWNER = b"arc", b"note", b"incarnation"


@pytest.mark.expect_log("arc of this node|about this node's arc")
@pytest.mark.parametrize(
    ("key", "value"), [(ARC, b"x"), (ARC, b"\xff" * 20 + b"\0" * 20), (ARC, None), (NOTE, None), (OWNER, b"another life's x")]
)
async def test_a_holding_that_cannot_be_ends_the_store(tmp_path: Path, key: bytes, value: bytes | None) -> None:
    async with whole_store(world(), tmp_path):
        pass

    def change(transaction: WriteTransaction) -> None:
        if value is None:
            transaction.delete(HOLDING, key)
        else:
            transaction.put(HOLDING, key, sealed(HOLDING, key, value))

    environment = LmdbDisk().open(tmp_path, TABLES)
    environment.update(change)
    environment.close()
    with pytest.raises(StoreDamaged) as caught:
        async with open_store(world(), tmp_path, NODE) as store:
            await store.holding()
    damage = str(caught.value)
    assert "this node" in damage and str(tmp_path) in damage and "wipe the folder" in damage
