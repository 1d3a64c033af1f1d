"""If this failed, two nodes that hold the same would compare it record by record, or what one of them lacks would go unnoticed."""

from __future__ import annotations

import hashlib
import random
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import trio
import trio.testing
from hypothesis import given, settings
from hypothesis import strategies as st

import scenefold.store
from scenefold.base.ids import SpaceId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import OBJECT_BYTES, PLACED_BY_NODE, Record, RecordPlace, signed_place
from scenefold.store import Held, Put, RangeSum, Spot, Store, building, digest_tree, open_store, version_of
from scenefold.store.changes import BuildDigests
from scenefold.store.digest_tree import LEVELS
from scenefold.store.layout import DIGESTS, IDENTITY, RECORDS, TABLES
from scenefold.store.sealing import sealed
from scenefold.store.writer import GroupWriter
from scenefold.world import Environment, World, WriteTransaction, offline_world
from scenefold.world.sim import Point, SimDisk, SimNet, run_simulated
from unit.store.samples import NODE, SCENE, SPACE, place, put, record, whole_store, world

FOLDER = Path("data")
SMALL = (4, 4, 4)
"""Parts of a piece, so that few records make many rows."""
EVERY_KEY = b"", b"\xff" * 64


@pytest.fixture
def _small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(digest_tree, "PARTS_MAX", SMALL)


def added_up(records: Sequence[Record]) -> RangeSum:
    """As the page says, and not as the code does."""
    versions = [hashlib.sha256(b"scenefold/version" + kept.header_bytes).digest()[:16] for kept in records]
    return RangeSum(len(records), sum(int.from_bytes(version, "big") for version in versions) % (1 << 128))


def homes_of(records: Sequence[Record]) -> list[Location]:
    return [Spot(RecordPlace(kept.header.scene, kept.header.space, kept.header.location), name).home for kept, name in named(records)]


def named(records: Sequence[Record]) -> Iterator[tuple[Record, bytes]]:
    for kept in records:
        yield kept, bytes(kept.header.location[-OBJECT_BYTES:]) if kept.header.placement == PLACED_BY_NODE else b""


def counted(records: Sequence[Record], piece: Arc) -> RangeSum:
    """What a tree that forgot nothing says."""
    return added_up([kept for kept, home in zip(records, homes_of(records), strict=True) if home in piece])


def thing(number: int, seq: int = 1) -> Record:
    """An object whose home is at the place 2^32 * number."""
    fixed = record(0, seq=seq)
    header = fixed.header._replace(location=signed_place(number.to_bytes(OBJECT_BYTES, "big")), placement=PLACED_BY_NODE)
    return Record(header.encode(), fixed.signature, fixed.ciphertext)


def check_rows(disk: SimDisk) -> None:
    """Each level says the same, its bounds are bounds of the level below, and no piece is larger than it may be."""
    rows = {key: value for key, value in disk.peek(DIGESTS).items() if len(key) == 27}
    for space in {key[:6] for key in rows}:
        levels = [{key[7:]: value for key, value in rows.items() if key[:7] == space + bytes([level])} for level in range(1, LEVELS + 1)]
        totals = []
        for level, pieces in enumerate(levels):
            read = {bound: digest_tree._ROW.unpack(value[:-4]) for bound, value in pieces.items()}
            totals.append((sum(row[1] for row in read.values()), sum(int.from_bytes(row[2], "big") for row in read.values()) % (1 << 128)))
            assert max(pieces) == b"\xff" * 20
            assert all(row[0] <= digest_tree.PARTS_MAX[level] for row in read.values())
            if level:
                assert set(pieces) <= set(levels[level - 1])
                assert sum(row[0] for row in read.values()) == len(levels[level - 1])
        assert len(set(totals)) == 1


class Shop:
    """A store on a simulated disk, and what should be in it."""

    def __init__(self, store: Store, dice: random.Random, disk: SimDisk) -> None:
        self.store, self.dice, self.disk = store, dice, disk
        self.kept: dict[tuple[int, Location], Record] = {}
        self.seq = 0

    def _wanted(self) -> list[Record]:
        """New versions: at places of their own, near each other, or of objects."""
        self.seq += 1
        count = self.dice.choice([1, 1, 3, 40])
        cluster = self.dice.choice([0, 5 << 32, 1 << 159])
        return [
            thing(self.dice.randrange(1, 12), self.seq)
            if self.dice.random() < 0.2
            else record(cluster + self.dice.randrange(60) if self.dice.random() < 0.7 else self.dice.getrandbits(160), seq=self.seq)
            for _ in range(count)
        ]

    async def step(self) -> None:
        kind = self.dice.choice(["put", "put", "put", "merge", "remove", "remove", "slide"])
        if kind in {"put", "merge"}:
            wanted = {self._key(new): new for new in self._wanted()}
            if kind == "put":
                await self.store.put([Put(new) for new in wanted.values()])
            else:
                at = Location.from_number(self.dice.getrandbits(160))
                await self.store.merge([Put(new, at=at) for new in wanted.values()])
            self.kept |= wanted
        elif kind == "remove":
            page = await self.store.manifest(WHOLE_LINE, None, 10_000)
            gone = self.dice.sample(page.entries, min(len(page.entries), self.dice.choice([1, 5, 100])))
            assert await self.store.remove([(entry.spot, entry.digest) for entry in gone]) == len(gone)
            for entry in gone:
                del self.kept[bool(entry.object), entry.home]
        else:
            cut = self.dice.randrange(1, 12) << 32
            await self.store.slide([Arc(WHOLE_LINE.first, Location.from_number(cut)), Arc(Location.from_number(cut + 1), WHOLE_LINE.last)])

    @staticmethod
    def _key(new: Record) -> tuple[int, Location]:
        return new.header.placement == PLACED_BY_NODE, homes_of([new])[0]

    async def check(self) -> None:
        records = list(self.kept.values())
        bounds = [home.number + step for home in homes_of(records) for step in (-1, 0, 1)]
        bounds = [number for number in bounds if 0 <= number < 1 << 160] + [0, (1 << 160) - 1, self.dice.getrandbits(160)]
        pairs = [sorted(self.dice.choices(bounds, k=2)) for _ in range(12)]
        arcs = [Arc(Location.from_number(first), Location.from_number(last)) for first, last in pairs]
        assert await self.store.sums(SCENE, SPACE, [WHOLE_LINE, *arcs]) == [counted(records, piece) for piece in (WHOLE_LINE, *arcs)]
        check_rows(self.disk)


@pytest.mark.usefixtures("_small_pieces")
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1 << 32))
def test_the_tree_says_what_a_count_says(seed: int) -> None:
    disk = SimDisk()

    async def trial() -> None:
        async with whole_store(offline_world(disk=disk), FOLDER) as store:
            shop = Shop(store, random.Random(seed), disk)
            for _ in range(25):
                await shop.step()
                await shop.check()

    trio.run(trial)


async def test_thousands_at_places_that_are_alike(tmp_path: Path) -> None:
    records = [record((7 << 150) + number) for number in range(2_000)]
    async with whole_store(world(map_bytes=1 << 26), tmp_path) as store:
        await store.put([Put(new) for new in records])
        piece = Arc(records[17].header.location, records[1_502].header.location)
        assert await store.sums(SCENE, SPACE, [piece, WHOLE_LINE]) == [added_up(records[17:1_503]), added_up(records)]
        assert await store.spaces() == [(SCENE, SPACE)]
        assert await store.sums(SCENE, SpaceId(9), [WHOLE_LINE]) == [RangeSum()]
        gone = [(Spot(place((7 << 150) + number)), kept.header.digest) for number, kept in enumerate(records)]
        await store.remove(gone[:-1])
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records[-1:])]


def test_a_version_is_the_whole_header() -> None:
    one, other = record(1).header, record(1, seq=2).header
    assert one.digest == other.digest, "any writer may sign it again"
    assert version_of(one.encode()) != version_of(other.encode())
    assert version_of(one.encode()).hex() == GOLDEN


GOLDEN = "0c867a5c4c49915f212aaa437feb31f4cb07e19fe069aac38f8252cfaa922bf1"


@pytest.mark.usefixtures("_small_pieces")
async def test_a_list_goes_by_homes_as_the_sums_do(tmp_path: Path) -> None:
    records = [*(record(number << 32) for number in range(1, 9)), thing(3), thing(5)]
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(new) for new in records])
        await store.merge([Put(thing(6, 2), at=Location.from_number(1))])
        records.append(thing(6, 2))
        whole = await store.listing(SCENE, SPACE, WHOLE_LINE, 100)
        assert whole.complete and whole.covered == WHOLE_LINE
        assert sorted(held.version for held in whole.records) == sorted(version_of(kept.header_bytes) for kept in records)
        assert [held.home for held in whole.records] == sorted(homes_of(records))
        assert {held.header for held in whole.records} == {kept.header_bytes for kept in records}
        assert await store.digests([held.spot for held in whole.records]) != [], "they are named by where they lie"
        found: list[Held] = []
        rest: Arc | None = WHOLE_LINE
        while rest is not None:
            page = await store.listing(SCENE, SPACE, rest, 2)
            assert await store.sums(SCENE, SPACE, [page.covered]) == [
                RangeSum(len(page.records), sum(int.from_bytes(held.version[:16], "big") for held in page.records) % (1 << 128))
            ]
            found += page.records
            following = page.covered.last.next()
            rest = None if page.complete or following is None else Arc(following, WHOLE_LINE.last)
        assert found == whole.records


# ----------------------------------------------------------------------------------------------------------- one door


def test_records_are_written_through_one_door() -> None:
    folder = Path(next(iter(scenefold.store.__path__)))
    writing = [
        path.name for path in sorted(folder.glob("*.py")) if re.search(r"\.(put|delete)\(RECORDS\b", path.read_text(encoding="utf-8"))
    ]
    assert writing == ["keeping.py"]


# ------------------------------------------------------------------------------------------------------------- damage


def turned(disk: SimDisk, table: str, key: bytes, byte: int) -> None:
    """Turn a bit of a value over."""
    [folder] = disk._folders.values()
    value = bytearray(folder.tables[table].values[key])
    value[byte] ^= 1
    folder.rot(table, key, bytes(value))


@contextmanager
def at_once(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Trees are built a few records at a time."""
    with monkeypatch.context() as patching:
        patching.setattr(building, "STEP_RECORDS", 3)
        yield


HEAL: dict[str, Callable[[Store, list[Record]], Any]] = {
    "the same again": lambda store, records: store.put([Put(records[3])]),
    "a copy": lambda store, records: store.merge([Put(records[3])]),
    "a newer one": lambda store, records: store.merge([Put(record(3, seq=9))]),
}


@pytest.mark.expect_log("whose header has changed on the disk")
@pytest.mark.usefixtures("_small_pieces")
@pytest.mark.parametrize("how", HEAL)
async def test_what_is_written_over_a_wreck_counts_and_the_wreck_does_not(how: str) -> None:
    disk = SimDisk()
    records = [record(number) for number in range(10)]
    async with whole_store(offline_world(disk=disk), FOLDER) as store:
        await store.put([Put(new) for new in records])
        [key] = [key for key in disk.peek(RECORDS) if key.endswith(b"\3")]
        turned(disk, RECORDS, key, 70)
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)], "nobody has met it yet"
        await HEAL[how](store, records)
        if how == "a newer one":
            records[3] = record(3, seq=9)
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)]
        check_rows(disk)


@pytest.mark.expect_log("whose header has changed on the disk")
@pytest.mark.usefixtures("_small_pieces")
async def test_a_wreck_that_is_deleted_is_gone_and_one_beside_it_counts_no_more() -> None:
    disk = SimDisk()
    records = [record(number) for number in range(10)]
    async with whole_store(offline_world(disk=disk), FOLDER) as store:
        await store.put([Put(new) for new in records])
        for key in [key for key in disk.peek(RECORDS) if key[-1] in {4, 5}]:
            turned(disk, RECORDS, key, 70)
        assert await store.discard([Spot(place(4))]) == 1
        left = records[:4] + records[6:]
        first, second = await store.sums(SCENE, SPACE, [WHOLE_LINE, Arc(Location.from_number(4), Location.from_number(5))])
        assert first in (added_up(left), added_up([*left, records[5]]))
        assert second.records in (0, 1)
        check_rows(disk)
        await store.put([Put(records[4]), Put(records[5])])
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)]
        check_rows(disk)


def rows_of(disk: SimDisk) -> list[bytes]:
    return [key for key in disk.peek(DIGESTS) if len(key) == 27]


@pytest.mark.expect_log("are made anew from its records")
@pytest.mark.usefixtures("_small_pieces")
@pytest.mark.parametrize("is_met_by", ["a reader", "a writer"])
def test_a_damaged_tree_is_made_anew_while_all_goes_on(is_met_by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SimDisk()
    records = [record(number << 140) for number in range(40)]
    piece = Arc(Location.from_number(7 << 140), Location.from_number(30 << 140))

    async def trial(number: int) -> None:
        async with whole_store(offline_world(disk=disk), FOLDER) as store:
            await store.put([Put(new) for new in records])
            turned(disk, DIGESTS, rows_of(disk)[number], 5)
            if is_met_by == "a writer":
                records.extend(record(((number + 2) * 100 + step << 140) + 1) for step in range(40))
                await store.put([Put(new) for new in records[-40:]])
            each = [Arc(home, home) for home in homes_of(records)]
            assert await store.sums(SCENE, SPACE, each) == [added_up([kept]) for kept in records], "whichever row it is, it is met"
            for step in range(4 * len(records)):
                assert await store.sums(SCENE, SPACE, [WHOLE_LINE, piece]) == [added_up(records), counted(records, piece)]
                records.append(record((((number + 2) * 1000 + len(records)) << 130) + 7))
                await store.put([Put(records[-1])])
                left = [key for key in disk.peek(DIGESTS) if len(key) != 27]
                if step > 20 and not left:
                    break
            check_rows(disk)
            assert not left, "three records a commit are built while one is put: it is whole again"

    with at_once(monkeypatch):
        for number in (0, 7, -1):
            trio.run(trial, number)


# -------------------------------------------------------------------------------------------------------- older folders


def date_back(transaction: WriteTransaction) -> None:
    """Make a folder one of format 3."""
    for key in list(transaction.keys(DIGESTS, *EVERY_KEY)):
        transaction.delete(DIGESTS, key)
    transaction.put(IDENTITY, b"format", sealed(IDENTITY, b"format", b"\0\0\0\3"))


def changed(disk: SimDisk, change: Callable[[WriteTransaction], None]) -> None:
    environment: Environment = disk.open(FOLDER, TABLES)
    environment.update(change)
    environment.close()


async def one_step(writer: GroupWriter) -> None:
    await writer.submit(BuildDigests(3))


@pytest.mark.usefixtures("_small_pieces")
async def test_a_folder_of_format_3_gets_its_tree_while_the_node_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SimDisk()
    world: World = offline_world(disk=disk)
    records = [*(record(number << 100) for number in range(30)), thing(4), thing(9)]
    async with whole_store(world, FOLDER) as store:
        await store.put([Put(new) for new in records])
    changed(disk, date_back)
    for _ in range(3):
        with monkeypatch.context() as patching:
            patching.setattr("scenefold.store.store.keep_building", one_step)
            async with whole_store(world, FOLDER) as store:
                await trio.testing.wait_all_tasks_blocked()
                assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)], "what is not built is counted"
        assert [len(key) for key in disk.peek(DIGESTS) if len(key) != 27] == [10], "it has only begun"
    with at_once(monkeypatch):
        async with whole_store(world, FOLDER) as store:
            while any(len(key) != 27 for key in disk.peek(DIGESTS)):
                records.append(record((len(records) % 7 * 5 << 100) + len(records)))
                await store.put([Put(records[-1])])
                assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)]
    check_rows(disk)
    async with whole_store(world, FOLDER) as store:
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(records)]


def test_no_crash_parts_the_tree_from_the_records(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(digest_tree, "PARTS_MAX", SMALL)
    for seed in range(6):
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
                page = await store.manifest(WHOLE_LINE, None, 10_000)
                there = [kept for kept in await store.read([entry.spot for entry in page.entries]) if isinstance(kept, Record)]
                assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [added_up(there)]
                net.trap(address, dice.choice([Point.BEFORE_COMMIT, Point.AFTER_COMMIT]), dice.randint(2, 20), crash)
                for step in range(20):
                    await store.put([put(dice.randrange(200), seq=life * 100 + step) for _ in range(6)])
                crash()
        await trio.sleep(2)
