"""If this failed, a node would forget whom it owes a record to, and an acknowledged one would lie on fewer disks than was said."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import trio
import trio.testing
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import Record
from scenefold.store import Debt, Outcome, Put, Spot, Store, StoreDamaged, open_store, version_of, writer
from scenefold.store.layout import DEBTORS, DEBTS, RECORDS
from scenefold.store.writer import RIDE_S
from scenefold.world import World, offline_world
from scenefold.world.sim import Point, SimDisk, SimNet, run_simulated
from unit.inline_workers import InlineWorkers
from unit.store.samples import NODE, NOWHERE, arc, managed, object_id, place, put, record, whole_store, world
from unit.store.test_damage import raw, rot

FOLDER = Path("data")
ONE, TWO, THREE = NodeId(1), NodeId(2), NodeId(3)


def timed_world(disk: SimDisk) -> World:
    """One in which time passes only when nothing is left to be done."""
    return replace(offline_world(disk=disk), workers=InlineWorkers())


def version(kept: Record) -> bytes:
    return version_of(kept.header_bytes)


async def all_debts(store: Store, limit: int = 3) -> list[Debt]:
    debts, cursor = [], None
    while True:
        page = await store.debts(cursor, limit)
        debts += page.debts
        cursor = page.after
        if cursor is None:
            return debts


async def commit(store: Store) -> None:
    """Whatever waits to ride along does so."""
    await store.put_note("any", b"")


async def test_a_debt_is_written_with_its_record_and_is_of_that_version(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        before = store.commits
        await store.put([put(1), put(2), put(3)], debtors=[(TWO, ONE, TWO), (), [THREE]])
        assert store.commits == before + 1
        assert await all_debts(store) == [
            Debt(Spot(place(1)), version(record(1)), (ONE, TWO)),
            Debt(Spot(place(3)), version(record(3)), (THREE,)),
        ]
        assert await store.debtors_of([Spot(place(number)) for number in (3, 2, 1)]) == [(THREE,), (), (ONE, TWO)]
        assert store.owed == {ONE: 1, TWO: 1, THREE: 1}
    async with open_store(world(), tmp_path, NODE) as store:
        assert len(await all_debts(store)) == 2
        assert store.owed == {ONE: 1, TWO: 1, THREE: 1}


async def test_what_is_not_written_owes_what_it_owed(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, seq=5), put(2, seq=5)], debtors=[(ONE,), ()])
        puts = [put(1, seq=5), put(1, seq=4), put(1, seq=6, expects=NOWHERE), put(2, seq=5)]
        results = await store.put(puts, debtors=[(THREE,)] * 4)
        assert [result.outcome for result in results] == [Outcome.STORED, Outcome.STALE, Outcome.EXISTS, Outcome.STORED]
        assert await all_debts(store) == [Debt(Spot(place(1)), version(record(1, seq=5)), (ONE,))]
        await store.put_holding(arc(7, 9), b"")
        await store.put([put(3)], debtors=[(ONE,)])
        assert store.owed == {ONE: 1}, "it is not ours"


async def test_a_newer_version_takes_the_debt_away_and_brings_its_own(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2), put(3)], debtors=[(ONE,)] * 3)
        await store.put([put(1, seq=2)], debtors=[(TWO,)])
        await store.merge([put(2, seq=2)])
        await store.merge([put(3, seq=2), put(4)], debtors=[(THREE,), (THREE,)])
        assert [(debt.spot.place.location.number, debt.nodes) for debt in await all_debts(store)] == [
            (1, (TWO,)),
            (3, (THREE,)),
            (4, (THREE,)),
        ]
        assert store.owed == {TWO: 1, THREE: 2}


async def test_paying_is_of_a_version_and_of_a_node(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        old, new = record(1), record(1, seq=2)
        assert old.header.digest == new.header.digest
        await store.put([Put(old)], debtors=[(ONE, TWO)])
        await store.put([Put(new)], debtors=[(ONE, TWO)])
        spot = Spot(place(1))
        await store.paid([(spot, version(old), ONE), (spot, version(new), THREE), (Spot(place(2)), version(new), ONE)])
        await commit(store)
        assert await store.debtors_of([spot]) == [(ONE, TWO)]
        await store.paid([(spot, version(new), TWO), (spot, version(new), TWO)])
        await commit(store)
        assert await store.debtors_of([spot]) == [(ONE,)] and store.owed == {ONE: 1}
        await store.paid([(spot, version(new), ONE)])
        await commit(store)
        assert await all_debts(store) == [] and store.owed == {}
    assert not any(table in (DEBTS, DEBTORS) for table, _ in raw(tmp_path))


async def test_a_record_takes_its_debt_with_it(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2)], debtors=[(ONE,)] * 2)
        await store.remove([(Spot(place(1)), record(1).header.digest)])
        await store.remove([(Spot(place(2)), NOWHERE)])
        assert [debt.spot for debt in await all_debts(store)] == [Spot(place(2))] and store.owed == {ONE: 1}
        thing = managed(5)
        await store.put([Put(thing)], debtors=[(TWO,)])
        home = Spot(place(0), object_id(5)).home
        behind = Location.from_number(home.number + 1)
        await store.put_holding(Arc(behind, WHOLE_LINE.last), b"")
        await store.merge([Put(thing, at=behind)])
        assert await store.debtors_of([Spot(place(behind.number), object_id(5))]) == [(TWO,)]
        assert await store.slide([Arc(WHOLE_LINE.first, home), Arc(behind, WHOLE_LINE.last)]) == 1
        assert [debt.spot.place.location for debt in await all_debts(store)][1:] == [home]
        assert await store.debtors_of([Spot(place(behind.number), object_id(5))]) == [(TWO,)], "wherever it is"
        await store.paid([(Spot(place(behind.number), object_id(5)), version(thing), TWO)])
        await commit(store)
        assert store.owed == {ONE: 1}


@pytest.mark.parametrize(
    "byte",
    [pytest.param(60, marks=pytest.mark.expect_log("whose header has changed on the disk"), id="header"), pytest.param(300, id="body")],
)
async def test_what_is_healed_is_still_owed(tmp_path: Path, byte: int) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2)], debtors=[(ONE,), (ONE,)])
    for table, key in list(raw(tmp_path)):
        if table == RECORDS:
            rot(tmp_path, table, key, bit=8 * byte)
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)], debtors=[(THREE,)])
        assert await store.debtors_of([Spot(place(1))]) == [(ONE,)]
        await store.discard([Spot(place(2))])
        assert store.owed == {ONE: 1}


# --------------------------------------------------------------------------------------------------- riding along


async def test_what_is_paid_shares_the_next_commit(autojump_clock: trio.testing.MockClock) -> None:
    async with whole_store(timed_world(SimDisk()), FOLDER) as store:
        await store.put([put(1)], debtors=[(ONE, TWO)])
        before = store.commits
        await store.paid([(Spot(place(1)), version(record(1)), ONE)])
        await trio.testing.wait_all_tasks_blocked()
        assert store.commits == before, "it forces none"
        await store.put([put(2)])
        assert store.commits == before + 1 and store.owed == {TWO: 1}
        await trio.sleep(2 * RIDE_S)
        assert store.commits == before + 1, "nothing is left to be done"


async def test_what_is_paid_waits_no_longer_than_a_second(autojump_clock: trio.testing.MockClock) -> None:
    async with whole_store(timed_world(SimDisk()), FOLDER) as store:
        await store.put([put(1), put(2)], debtors=[(ONE,)] * 2)
        before = store.commits
        await store.paid([(Spot(place(1)), version(record(1)), ONE)])
        await trio.sleep(0.6 * RIDE_S)
        await store.paid([(Spot(place(2)), version(record(2)), ONE)])
        assert store.owed == {ONE: 2}
        await trio.sleep(0.5 * RIDE_S)
        assert store.owed == {} and store.commits == before + 1


async def test_only_so_many_wait(autojump_clock: trio.testing.MockClock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "RIDERS_MAX", 4)
    async with whole_store(timed_world(SimDisk()), FOLDER) as store:
        await store.put([put(number) for number in range(10)], debtors=[(ONE,)] * 10)
        begin = trio.current_time()
        async with trio.open_nursery() as nursery:
            for number in range(10):
                nursery.start_soon(store.paid, [(Spot(place(number)), version(record(number)), ONE)])
        assert trio.current_time() == begin
        await commit(store)
        assert store.owed == {}


async def test_a_store_that_closes_takes_none(autojump_clock: trio.testing.MockClock) -> None:
    async with whole_store(timed_world(SimDisk()), FOLDER) as store:
        await store.put([put(1)], debtors=[(ONE,)])
    with pytest.raises(Refused):
        await store.paid([(Spot(place(1)), version(record(1)), ONE)])


@pytest.mark.expect_log("the disk is full but for its reserve")
async def test_debts_are_paid_on_a_full_disk(autojump_clock: trio.testing.MockClock) -> None:
    disk = SimDisk()
    async with whole_store(timed_world(disk), FOLDER) as store:
        await store.put([put(1)], debtors=[(ONE,)])
        disk.fill(1 << 20)
        [result] = await store.put([put(2)], debtors=[(ONE,)])
        assert result.outcome is Outcome.FULL and store.owed == {ONE: 1}
        await store.paid([(Spot(place(1)), version(record(1)), ONE)])
        await trio.sleep(2 * RIDE_S)
        assert store.owed == {}


# ---------------------------------------------------------------------------------------------- damage and crashes


@pytest.mark.expect_log("the debts are counted instead")
async def test_rotten_counts_follow_from_the_debts(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1), put(2)], debtors=[(ONE, TWO), (ONE,)])
    for table, key in list(raw(tmp_path)):
        if table == DEBTORS:
            rot(tmp_path, table, key)
    async with open_store(world(), tmp_path, NODE) as store:
        assert store.owed == {ONE: 2, TWO: 1}
        await store.put([put(3)], debtors=[(ONE,)])
        assert store.owed == {ONE: 3, TWO: 1}


@pytest.mark.expect_log("has changed on the disk")
async def test_a_rotten_debt_ends_the_store(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)], debtors=[(ONE,)])
    rot(tmp_path, DEBTS, next(key for table, key in raw(tmp_path) if table == DEBTS))
    with pytest.raises(StoreDamaged):
        async with open_store(world(), tmp_path, NODE) as store:
            await store.debts(None, 10)


class Ledger:
    """What should be owed, beside a store."""

    def __init__(self, dice: random.Random) -> None:
        self.dice = dice
        self.records: dict[int, Record] = {}
        self.owed: dict[int, tuple[NodeId, ...]] = {}
        self.seq = 0

    def _nodes(self) -> tuple[NodeId, ...]:
        return tuple(sorted(self.dice.sample([ONE, TWO, THREE], self.dice.randrange(4))))

    async def step(self, store: Store) -> None:
        numbers = self.dice.sample(range(8), self.dice.randint(1, 4))
        kind = self.dice.choice(["put", "put", "again", "merge", "remove", "pay", "pay"])
        if kind in {"put", "merge"}:
            self.seq += 1
            nodes = {number: self._nodes() for number in numbers}
            for number in numbers:
                self.records[number] = record(number, seq=self.seq)
                self.owed[number] = nodes[number]
            await (store.put if kind == "put" else store.merge)([Put(self.records[number]) for number in numbers], list(nodes.values()))
        elif kind == "again":
            there = [number for number in numbers if number in self.records]
            await store.put([Put(self.records[number]) for number in there], [self._nodes() for _ in there])
        elif kind == "remove":
            gone = [(Spot(place(number)), self.records.pop(number).header.digest) for number in numbers if number in self.records]
            self.owed = {number: nodes for number, nodes in self.owed.items() if number in self.records}
            await store.remove(gone)
        else:
            node = self.dice.choice([ONE, TWO, THREE])
            of = {number: self.records.get(number, record(number)) for number in numbers}
            if self.dice.random() < 0.3:
                of = {number: record(number, seq=self.seq + 5) for number in numbers}
            for number, kept in of.items():
                if self.records.get(number) == kept:
                    self.owed[number] = tuple(other for other in self.owed[number] if other != node)
            await store.paid([(Spot(place(number)), version(kept), node) for number, kept in of.items()])

    async def check(self, store: Store) -> None:
        await commit(store)
        expected = {Spot(place(number)): (version(self.records[number]), nodes) for number, nodes in self.owed.items() if nodes}
        assert {debt.spot: (debt.version, debt.nodes) for debt in await all_debts(store)} == expected
        assert store.owed == dict(Counter(node for nodes in self.owed.values() for node in nodes))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1 << 32))
def test_any_order_of_changes_leaves_what_a_ledger_has(seed: int) -> None:
    async def trial() -> None:
        disk, ledger = SimDisk(), Ledger(random.Random(seed))
        for _ in range(2):
            async with whole_store(timed_world(disk), FOLDER) as store:
                await ledger.check(store)
                for _ in range(20):
                    await ledger.step(store)
                    await ledger.check(store)

    trio.run(trial)


@pytest.mark.parametrize("seed", range(6))
def test_no_crash_parts_a_record_from_its_debt(seed: int) -> None:
    run_simulated(seed, crashes, seed)


async def crashes(seed: int) -> None:
    net, dice, address = SimNet(seed), random.Random(seed), "10.0.0.1"
    for life in range(4):
        with trio.CancelScope() as scope:

            def crash(scope: trio.CancelScope = scope) -> None:
                net.crash(address, torn=dice.random() < 0.5)
                scope.cancel()

            async with open_store(net.world(f"node:{NODE}", address), FOLDER, NODE) as store:
                await store.put_holding(WHOLE_LINE, b"")
                page = await store.manifest(WHOLE_LINE, None, 100)
                there = await store.read([entry.spot for entry in page.entries])
                versions = {entry.spot: version(kept) for entry, kept in zip(page.entries, there, strict=True) if isinstance(kept, Record)}
                debts = await all_debts(store)
                assert {debt.spot: debt.version for debt in debts} == versions, "no node ever paid"
                assert store.owed == dict(Counter(node for debt in debts for node in debt.nodes))
                net.trap(address, dice.choice([Point.BEFORE_COMMIT, Point.AFTER_COMMIT]), dice.randint(2, 20), crash)
                for step in range(20):
                    numbers = dice.sample(range(9), 3)
                    nodes = [dice.choice([(ONE,), (ONE, TWO), (THREE,)]) for _ in numbers]
                    await store.put([put(number, seq=life * 100 + step + 1) for number in numbers], nodes)
                crash()
        await trio.sleep(2)
