"""If this failed, a damaged store would be called sound, or a sound one damaged, or repair would lose what only it has."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import trio
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import Record
from scenefold.store import Put, Spot, digest_tree, open_store, version_of
from scenefold.store.changes import BuildDigests
from scenefold.store.checking import Findings, Helps, check_format, check_store, mend, nobody_can_tell, read_identity
from scenefold.store.debts import pack_debt
from scenefold.store.identity import FORMAT_VERSION
from scenefold.store.layout import (
    DEBTORS,
    DEBTS,
    DIGESTS,
    HOLDING,
    IDENTITY,
    NOTES,
    OBJECTS,
    RECORDS,
    STATISTICS,
    SUSPECTS,
    TABLES,
    pack_record,
    record_key,
)
from scenefold.store.sealing import SealedEnvironment, sealed
from scenefold.store.writer import commit
from scenefold.world import Environment, WriteTransaction, offline_world
from scenefold.world.sim import SimDisk
from unit.store.samples import NODE, SCENE, SPACE, managed, object_id, place, put, record, whole_store
from unit.store.test_digests import Shop

FOLDER = Path("data")
EVERY_KEY = b"", b"\xff" * 64
OTHERS = NodeId(8), NodeId(9)


@contextmanager
def on(disk: SimDisk) -> Iterator[Environment]:
    """The tables as they are, while no store is open."""
    environment = disk.open(FOLDER, TABLES)
    try:
        yield environment
    finally:
        environment.close()


def looked(disk: SimDisk, judge: Any = nobody_can_tell) -> Findings:
    with on(disk) as environment, environment.read() as view:
        return check_store(view, judge)


def told(found: Findings) -> list[tuple[str, str]]:
    return sorted({(finding.table, str(finding.helps)) for finding in found.listed})


def mended(disk: SimDisk, judge: Any = nobody_can_tell) -> tuple[int, Findings]:
    with on(disk) as environment:
        done = mend(environment, "here", lambda view: check_store(view, judge))
        return len(done.done), done.left


def changed(disk: SimDisk, table: str, key: bytes, value: bytes | None) -> None:
    """What stands on the disk is this from now on."""

    def change(transaction: WriteTransaction) -> None:
        if value is None:
            transaction.delete(table, key)
        else:
            transaction.put(table, key, value)

    with on(disk) as environment:
        environment.update(change)


def raw(disk: SimDisk, table: str) -> dict[bytes, bytes]:
    return dict(disk.peek(table))


async def fill(disk: SimDisk, count: int = 200) -> None:
    """A store with something in every table."""
    async with whole_store(offline_world(disk=disk), FOLDER) as store:
        await store.put([put(number << 140) for number in range(1, count)])
        await store.put([put(3)], [OTHERS])
        await store.put([put(4), put(1, space=SpaceId(3))], [OTHERS[:1], ()])
        await store.put([Put(managed(number)) for number in range(20)])
        await store.put_holding(Arc(Location.from_number(0), Location.from_number(1 << 159)), b"")
        await store.merge([Put(managed(number), at=Location.from_number(number)) for number in range(20, 60)])
        await store.put_note("a note", b"value")
        await store.put_header(SCENE, b"header")
        await store.put_holding(WHOLE_LINE, b"")


async def filled() -> SimDisk:
    disk = SimDisk()
    await fill(disk)
    return disk


async def contents(disk: SimDisk) -> dict[Spot, Record | None]:
    """Whatever can be read, as a node would read it."""
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        page = await store.manifest(WHOLE_LINE, None, 10_000)
        found = await store.read([entry.spot for entry in page.entries])
        return {entry.spot: one if isinstance(one, Record) else None for entry, one in zip(page.entries, found, strict=True)}


async def test_a_store_in_which_all_is_well_is_called_sound() -> None:
    disk = await filled()
    before = {table: raw(disk, table) for table in TABLES}
    found = looked(disk)
    assert told(found) == []
    assert found.is_sound and found.records.records == len(before[RECORDS]) > 200
    assert {table: raw(disk, table) for table in TABLES} == before
    assert mended(disk)[0] == 0


def test_a_new_folder_is_sound() -> None:
    assert looked(SimDisk()).is_sound


WIPE, MEND, FETCH = "wipe", "mend", "fetch"
HELPS = {
    RECORDS: FETCH,
    OBJECTS: MEND,
    STATISTICS: MEND,
    DIGESTS: MEND,
    DEBTORS: MEND,
    DEBTS: MEND,
    IDENTITY: WIPE,
    HOLDING: WIPE,
    NOTES: WIPE,
}


@pytest.mark.parametrize("table", HELPS)
async def test_a_bit_that_turns_over_is_found_wherever_it_is(table: str) -> None:
    """Each value once, and no other table is accused."""
    disk = await filled()
    dice = random.Random(table)
    keys = list(raw(disk, table))
    for key in keys if len(keys) < 12 else dice.sample(keys, 12):
        backup = disk.snapshot()
        disk.corrupt(table, dice, key)
        found = looked(disk)
        assert {(table, HELPS[table])} <= set(told(found)), key
        assert found.counts[Helps(HELPS[table])] == 1
        assert set(told(found)) <= {(table, HELPS[table]), (DIGESTS, MEND)}
        disk.restore(backup)


# A debt that is not there is not owed: what debtors count follows from debts.
@pytest.mark.parametrize(
    ("table", "how"), [(table, how) for table in (OBJECTS, STATISTICS, DIGESTS, DEBTORS, DEBTS) for how in ("rots", "goes")][:-1]
)
async def test_what_follows_from_something_else_is_made_anew(table: str, how: str) -> None:
    disk = await filled()
    before, tables = await contents(disk), {name: raw(disk, name) for name in TABLES}
    dice = random.Random(how)
    for key in dice.sample(sorted(tables[table]), min(3, len(tables[table]))):
        if how == "rots":
            disk.corrupt(table, dice, key)
        else:
            changed(disk, table, key, None)
    assert not looked(disk).is_sound
    done, left = mended(disk)
    assert done and left.is_sound and left.counts == {}
    for name in {RECORDS, OBJECTS, STATISTICS, NOTES, HOLDING} - ({DIGESTS} if table == DIGESTS else set()):
        assert raw(disk, name) == tables[name]
    assert await contents(disk) == before
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        (total,) = await store.sums(SCENE, SPACE, [WHOLE_LINE])
        assert total.records == len([spot for spot in before if spot.place.space == SPACE])
        assert set(store.owed) == set(OTHERS)


@pytest.mark.expect_log("has changed on the disk|have changed on the disk|left out of a list")
@pytest.mark.parametrize("byte", [9, 300], ids=["header", "ciphertext"])
async def test_a_rotten_record_stays_and_is_no_answer(byte: int) -> None:
    """Who deleted it would say that nothing is there, and be believed."""
    disk = await filled()
    key = record_key(place(3))
    value = bytearray(raw(disk, RECORDS)[key])
    value[byte % len(value)] ^= 1
    changed(disk, RECORDS, key, bytes(value))
    found = looked(disk)
    assert found.rotten == [Spot(place(3))] and told(found) == [(RECORDS, FETCH)]
    done, left = mended(disk)
    assert done == 0 and told(left) == [(RECORDS, FETCH)]
    assert raw(disk, RECORDS)[key] == bytes(value)
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        (answer,) = await store.read([Spot(place(3))])
        assert isinstance(answer, DamagedData)
        await store.merge([put(3)])
    assert looked(disk).is_sound


@pytest.mark.expect_log("have changed on the disk|left out of a list|has changed on the disk")
async def test_a_record_under_anothers_key_becomes_a_wreck() -> None:
    disk = await filled()
    changed(disk, RECORDS, record_key(place(3)), pack_record(record(5)))
    changed(disk, RECORDS, record_key(place(0), object_id(77)), pack_record(record(5)))
    assert (RECORDS, FETCH) in told(looked(disk))
    assert {spot.place.location.number for spot in looked(disk).rotten} == {0, 3}
    mended(disk)
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        (answer,) = await store.read([Spot(place(3))])
        assert isinstance(answer, DamagedData)
        await store.merge([put(3)])
        assert await store.get_many([place(3)]) == [record(3)]
    assert [spot.object for spot in looked(disk).rotten] == [object_id(77)]


@pytest.mark.expect_log("changed on the disk")
async def test_what_its_writer_did_not_sign_becomes_a_wreck() -> None:
    disk = await filled()

    def judge(spot: Spot, _record: Record, /) -> str | None:
        return "not signed by its writer" if spot.place == place(3) else None

    found = looked(disk, judge)
    assert told(found) == [(RECORDS, FETCH)] and found.signatures == found.records.records
    assert looked(disk).signatures == 0
    done, left = mended(disk, judge)
    assert done >= 1 and left.rotten == [Spot(place(3))]
    assert left.signatures == found.signatures - 1
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        assert isinstance((await store.read([Spot(place(3))]))[0], DamagedData)


async def test_a_key_that_names_no_place_is_deleted() -> None:
    disk = await filled()
    changed(disk, RECORDS, record_key(place(3))[:-1], b"what is this")
    assert told(looked(disk)) == [(RECORDS, MEND)]
    assert mended(disk)[1].is_sound
    assert record_key(place(3)) in raw(disk, RECORDS)


async def test_what_is_kept_apart_and_has_rotted_is_deleted() -> None:
    disk = await filled()
    key, value = next(iter(raw(disk, RECORDS).items()))
    rotten = value[:-1] + bytes([value[-1] ^ 1])
    for name, kept in ((key, value), (key[:-1] + bytes([key[-1] ^ 1]), rotten), (b"nowhere", value)):
        changed(disk, SUSPECTS, name, kept)
    assert told(looked(disk)) == [(SUSPECTS, "mend")]
    done, after = mended(disk)
    assert (done, after.is_sound, raw(disk, SUSPECTS)) == (2, True, {key: value})


async def test_of_two_records_of_one_object_the_newer_counts() -> None:
    disk = await filled()
    spots = [spot for spot in await contents(disk) if spot.object and spot.place.location != spot.home]
    newer, older, home = (Spot(spot.place, spot.object) for spot in spots[:3])
    numbers = {object_id(number): number for number in range(60)}
    for spot, seq, to in ((newer, 9, 1 << 90), (older, 0, 1 << 91)):
        moved = place(to)
        changed(disk, RECORDS, record_key(moved, spot.object), pack_record(managed(numbers[spot.object], seq=seq)))
    at_home = place(0)._replace(location=home.home)
    changed(disk, RECORDS, record_key(at_home, home.object), pack_record(managed(numbers[home.object], seq=9)))
    assert (RECORDS, MEND) in told(looked(disk))
    assert mended(disk)[1].is_sound
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        found = await store.read([Spot(place(0), spot.object) for spot in (newer, older, home)])
        assert [one.header.seq for one in found if isinstance(one, Record)] == [9, 1, 9]
        assert (await store.statistics()).records == len(raw(disk, RECORDS))


async def test_a_tree_that_is_not_finished_is_sound_as_far_as_it_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(digest_tree, "PARTS_MAX", (4, 4, 4))
    disk = await filled()
    disk.corrupt(DIGESTS, random.Random(1))
    assert mended(disk)[1].is_sound
    steps = 0
    while True:
        with on(disk) as environment:
            committed = commit(SealedEnvironment(environment, "here"), [BuildDigests(17)], 0)
        steps += 1
        assert told(looked(disk)) == []
        if not committed.is_unbuilt:
            break
    assert steps > 5
    built = sorted(key for key in raw(disk, DIGESTS) if len(key) > 20)
    disk.corrupt(DIGESTS, random.Random(1), built[len(built) // 2])
    assert told(looked(disk)) == [(DIGESTS, MEND)]


# -------------------------------------------------------------------------------------------------------------- debts


async def test_debts_fit_their_records() -> None:
    disk = await filled()
    stale, orphan = record_key(place(3)), record_key(place(1 << 100))
    changed(disk, DEBTS, stale, sealed(DEBTS, stale, pack_debt(bytes(32), OTHERS)))
    changed(disk, DEBTS, orphan, sealed(DEBTS, orphan, pack_debt(bytes(32), OTHERS)))
    assert told(looked(disk)) == [(DEBTORS, MEND), (DEBTS, MEND)]
    assert mended(disk)[1].is_sound
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        page = await store.debts(None, 10)
        assert [(debt.spot, debt.version, debt.nodes) for debt in page.debts] == [
            (Spot(place(3)), version_of(record(3).header_bytes), OTHERS),
            (Spot(place(4)), version_of(record(4).header_bytes), OTHERS[:1]),
        ]
        assert store.owed == {OTHERS[0]: 2, OTHERS[1]: 1}


async def test_rotten_debts_name_all_whom_debtors_count_beside() -> None:
    disk = await filled()
    for key in list(raw(disk, DEBTS)):
        disk.corrupt(DEBTS, random.Random(1), key)
    assert told(looked(disk)) == [(DEBTS, MEND)]
    assert mended(disk)[1].is_sound
    async with open_store(offline_world(disk=disk), FOLDER, NODE) as store:
        assert [debt.nodes for debt in (await store.debts(None, 10)).debts] == [OTHERS, OTHERS]


@pytest.mark.parametrize("also", [DEBTORS, RECORDS])
async def test_a_rotten_debt_that_follows_from_nothing_is_not_mended_and_nothing_else_is(also: str) -> None:
    disk = await filled()
    key = record_key(place(3))
    disk.corrupt(DEBTS, random.Random(1), key)
    value = bytearray(raw(disk, RECORDS)[key])
    if also == RECORDS:
        value[9] ^= 1
        changed(disk, RECORDS, key, bytes(value))
    else:
        disk.corrupt(DEBTORS, random.Random(1))
    disk.corrupt(STATISTICS, random.Random(1))
    before = {table: raw(disk, table) for table in TABLES}
    done, left = mended(disk)
    assert done == 0 and left.counts[Helps.WIPE] == 1 and (DEBTS, WIPE) in told(left)
    assert {table: raw(disk, table) for table in TABLES} == before


# ------------------------------------------------------------------------------------------------------ what does not follow


@pytest.mark.parametrize(
    "break_it",
    [
        lambda disk: changed(disk, IDENTITY, b"boot", None),
        lambda disk: changed(disk, IDENTITY, b"boot", sealed(IDENTITY, b"boot", b"?")),
        lambda disk: [changed(disk, IDENTITY, key, None) for key in list(raw(disk, IDENTITY))],
        lambda disk: changed(disk, IDENTITY, b"incarnation", sealed(IDENTITY, b"incarnation", bytes(16))),
        lambda disk: changed(disk, HOLDING, b"arc", None),
        lambda disk: changed(disk, HOLDING, b"arc", sealed(HOLDING, b"arc", b"no arc")),
    ],
    ids=["no boot", "boot", "no identity", "incarnation", "no arc", "arc"],
)
async def test_what_does_not_follow_is_said_to_be_beyond_repair(break_it: Callable[[SimDisk], Any]) -> None:
    disk = await filled()
    break_it(disk)
    disk.corrupt(STATISTICS, random.Random(1))
    assert looked(disk).counts[Helps.WIPE] == 1
    before = {table: raw(disk, table) for table in TABLES}
    assert mended(disk)[0] == 0
    assert {table: raw(disk, table) for table in TABLES} == before


@pytest.mark.parametrize(
    ("version", "is_plain", "words"), [(FORMAT_VERSION + 1, False, "newer"), (3, False, "earlier"), (1, True, "earlier")]
)
async def test_another_format_is_said_to_be_one(version: int, is_plain: bool, words: str) -> None:
    disk = await filled()
    number = version.to_bytes(4, "big")
    changed(disk, IDENTITY, b"format", number if is_plain else sealed(IDENTITY, b"format", number))
    with on(disk) as environment, environment.read() as view, pytest.raises(LocalFault, match=f"{words} scenefold") as fault:
        check_format(view, "here")
    assert fault.value.where == "here"


async def test_whose_folder_it_is() -> None:
    disk = await filled()
    with on(disk) as environment, environment.read() as view:
        check_format(view, "here")
        identity = read_identity(view)
    assert identity is not None and (identity.node, identity.boot) == (NODE, 1)
    disk.corrupt(IDENTITY, random.Random(1), b"boot")
    with on(disk) as environment, environment.read() as view:
        assert read_identity(view) is None


# --------------------------------------------------------------------------------------------------------- any order


@pytest.mark.expect_log("changed on the disk|left out of a list|made anew")
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1 << 32), hits=st.integers(0, 6))
def test_whatever_rots_is_found_and_what_can_be_mended_is(seed: int, hits: int) -> None:
    """Whatever was not hit is there afterwards, and a node starts; or it is said that it would not."""
    dice = random.Random(seed)

    async def play() -> None:
        disk = SimDisk()
        await fill(disk, count=30)
        before = await contents(disk)
        tables = dice.choices([RECORDS, OBJECTS, STATISTICS, DIGESTS, DEBTORS, DEBTS], k=hits)
        rotten = [(table, disk.corrupt(table, dice)) for table in tables]
        found = looked(disk)
        assert found.is_sound == (not {key for table, key in rotten if disk.rotten(table)})
        _, left = mended(disk)
        if left.counts[Helps.WIPE]:
            assert {DEBTS} <= set(tables)
            return
        assert not left.counts[Helps.MEND]
        after = await contents(disk)
        lost = {spot for spot in before if after.get(spot) is None}
        assert lost == set(left.rotten)
        assert {spot: one for spot, one in after.items() if spot not in lost} == {
            spot: one for spot, one in before.items() if spot not in lost
        }

    trio.run(play)


def test_a_store_is_sound_after_any_history(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pieces of the tree, so that many are cut and joined."""
    monkeypatch.setattr(digest_tree, "PARTS_MAX", (4, 4, 4))

    async def play() -> None:
        disk, shop = SimDisk(), None
        for _ in range(10):
            async with whole_store(offline_world(disk=disk), FOLDER) as store:
                shop = Shop(store, random.Random(7), disk) if shop is None else shop
                shop.store = store
                for _ in range(25):
                    await shop.step()
            assert told(looked(disk)) == []

    trio.run(play)
