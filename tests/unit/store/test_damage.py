"""If this failed, a bit that turned over on the disk would make a node somebody else, or the owner of what it does not own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.lives import Lives, note_of, pack_granted
from scenefold.peer.line.holding import Handover, Heard, Holding, Step
from scenefold.peer.line.holding_note import encode_holding
from scenefold.store import LmdbDisk, Put, Spot, StoreDamaged, open_store
from scenefold.store.layout import (
    DEBTORS,
    DEBTS,
    DIGESTS,
    HEADERS,
    HOLDING,
    IDENTITY,
    LOGS,
    NOTES,
    OBJECTS,
    RECORDS,
    STATISTICS,
    SUSPECTS,
    TABLES,
    location_of,
)
from scenefold.store.sealing import SEALED, opened, sealed
from scenefold.wire import Member
from scenefold.world import Environment, WriteTransaction
from unit.store.samples import NODE, SCENE, arc, managed, object_id, place, put, whole_store, world

EVERY_KEY = b"", b"\xff" * 64


def holding() -> Holding:
    """One with a piece that it has let go of."""

    def at(number: int) -> Location:
        return Location.from_number(number << 152)

    behind = Location.from_number((40 << 152) + 1)
    piece = Arc(Location.from_number((60 << 152) + 1), at(80))
    right = Handover(b"\0" * 7 + b"\5" + b"abcdefgh", Step.RELEASED, Member(NodeId(7), b"i" * 16), piece)
    return Holding(Arc(behind, at(60)), left=None, right=right, revision=9, heard=(Heard(Member(NodeId(6), b"j" * 16), 4),))


KEPT = {
    "arc": (HOLDING, b"arc", bytes(20) + b"\x7f" * 20),
    "no arc": (HOLDING, b"arc", b""),
    "holding note": (HOLDING, b"note", encode_holding(holding())),
    "format": (IDENTITY, b"format", b"\0\0\0\4"),
    "node": (IDENTITY, b"node", b"\x7f\0\0\2"),
    "incarnation": (IDENTITY, b"incarnation", b"i" * 16),
    "boot": (IDENTITY, b"boot", b"\0\0\0\5"),
    "own lives": (NOTES, b"cluster-log/lives", Lives(3, 5).pack()),
    "granted life": (NOTES, note_of(NODE).encode(), pack_granted(b"i" * 16, 77)),
    "page of the log": (NOTES, b"cluster-log/00000000", bytes(range(256))),
    "place of an object": (OBJECTS, b"\0\0\0\7\0\2" + b"o" * 16, b"\x11" * 20),
    "counts": (STATISTICS, b"\0\0\0\7\0\2", bytes(16)),
    "digests": (DIGESTS, b"\0\0\0\7\0\2\1" + b"\x11" * 20, bytes(28)),
    "debt": (DEBTS, b"\0\0\0\7\0\2" + b"\x11" * 20, bytes(range(36))),
    "debtor": (DEBTORS, b"\x7f\0\0\2", bytes(8)),
}


@pytest.mark.parametrize("what", KEPT)
def test_every_bit_that_turns_over_is_noticed(what: str) -> None:
    table, key, value = KEPT[what]
    stored = sealed(table, key, value)
    assert opened(table, key, memoryview(stored)) == value
    for bit in range(8 * len(stored)):
        changed = bytearray(stored)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(StoreDamaged, match="has changed on the disk"):
            opened(table, key, memoryview(changed))


@given(st.binary(max_size=60), st.data())
def test_no_burst_of_up_to_32_bits_passes(value: bytes, data: st.DataObject) -> None:
    stored = int.from_bytes(b"\1" + sealed(NOTES, b"n", value), "big")
    size = 8 * (len(value) + 4)
    burst = data.draw(st.integers(1, (1 << 32) - 1)) << data.draw(st.integers(0, size - 32))
    changed = (stored ^ burst).to_bytes(size // 8 + 1, "big")[1:]
    with pytest.raises(StoreDamaged):
        opened(NOTES, b"n", memoryview(changed))


@pytest.mark.parametrize("count", range(12))
def test_a_cut_value_is_noticed(count: int) -> None:
    with pytest.raises(StoreDamaged):
        opened(NOTES, b"n", memoryview(sealed(NOTES, b"n", b"12345678")[:count]))


def test_a_value_in_anothers_place_is_noticed() -> None:
    stored = memoryview(sealed(NOTES, b"one", b"value"))
    for table, key in ((NOTES, b"other"), (HOLDING, b"one")):
        with pytest.raises(StoreDamaged):
            opened(table, key, stored)


# ------------------------------------------------------------------------------------------------- of a whole store


@contextmanager
def on_the_disk(folder: Path) -> Iterator[Environment]:
    """The tables as they are, while no store is open."""
    environment = LmdbDisk().open(folder, TABLES)
    try:
        yield environment
    finally:
        environment.close()


def raw(folder: Path) -> dict[tuple[str, bytes], bytes]:
    with on_the_disk(folder) as environment, environment.read() as view:
        return {(table, key): bytes(value) for table in TABLES for key, value in view.scan(table, *EVERY_KEY)}


def rot(folder: Path, table: str, key: bytes, bit: int = 3) -> None:
    def turn(transaction: WriteTransaction) -> None:
        value = transaction.get(table, key)
        assert value is not None
        changed = bytearray(value)
        changed[bit // 8] ^= 1 << bit % 8
        transaction.put(table, key, bytes(changed))

    with on_the_disk(folder) as environment:
        environment.update(turn)


async def filled(folder: Path) -> None:
    """A store with something in every table."""
    async with whole_store(world(), folder) as store:
        await store.put([put(1), put(2)])
        await store.merge([Put(managed(5), at=Location.from_number(99))])
        await store.put_note("a note", b"value")
        await store.put_header(SCENE, b"header")


async def look_at_everything(folder: Path) -> None:
    """What a node reads of its store when it starts, and while it runs."""
    async with open_store(world(), folder, NODE) as store:
        await store.holding()
        await store.get_note("a note")
        await store.put([put(3)])


def test_everything_is_sealed_but_what_has_checks_of_its_own() -> None:
    assert set(TABLES) - set(SEALED) == {RECORDS, HEADERS, SUSPECTS, LOGS}


SAID = pytest.mark.expect_log("has changed on the disk")


@pytest.mark.parametrize("table", [IDENTITY, *(pytest.param(table, marks=SAID) for table in (HOLDING, NOTES))])
async def test_damage_ends_the_node_with_words_that_help(tmp_path: Path, table: str) -> None:
    await filled(tmp_path / "whole")
    keys = [key for name, key in raw(tmp_path / "whole") if name == table]
    assert keys
    for number, key in enumerate(keys):
        folder = tmp_path / str(number)
        await filled(folder)
        rot(folder, table, key)
        with pytest.raises(StoreDamaged) as caught:
            await look_at_everything(folder)
        assert caught.value.where == str(folder)
        assert f"in the table {table!r}" in caught.value.what, f"{key!r} was read as if it were whole"
        assert "wipe the folder" in caught.value.remedy and "newcomer" in caught.value.remedy


@SAID
async def test_a_put_meets_a_rotten_arc_and_is_not_acknowledged(tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, HOLDING, b"arc", bit=8 * 39)
    with pytest.raises(StoreDamaged):
        async with open_store(world(), tmp_path, NODE) as store:
            await store.put([put(3)])
    assert [key for table, key in raw(tmp_path) if table == RECORDS and key.endswith(b"\3")] == []


@SAID
async def test_a_rotten_place_of_an_object_ends_the_store_instead_of_hiding_the_object(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await store.put_holding(arc(0, 10), b"")
        await store.merge([Put(managed(5), at=Location.from_number(99))])
    (key,) = (key for table, key in raw(tmp_path) if table == OBJECTS)
    rot(tmp_path, OBJECTS, key)
    with pytest.raises(StoreDamaged):
        async with open_store(world(), tmp_path, NODE) as store:
            await store.read([Spot(place(98), object_id(5))])


@SAID
async def test_a_store_that_has_met_damage_takes_nothing_more(tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, NOTES, b"a note")

    async def meet() -> None:
        async with open_store(world(), tmp_path, NODE) as store:
            await store.put([put(3)])
            with pytest.raises(StoreDamaged):
                await store.get_note("a note")
            with trio.CancelScope(shield=True), pytest.raises(Refused) as refused:
                await store.put([put(4)])
            assert refused.value.reason is RejectReason.NOT_READY
            await trio.sleep_forever()

    with pytest.raises(StoreDamaged, match="'a note' in the table 'notes'"):
        await meet()
    stored = {location_of(key).number for table, key in raw(tmp_path) if table == RECORDS}
    assert 3 in stored and 4 not in stored


@pytest.mark.expect_log("the records are counted instead")
async def test_rotten_counts_follow_from_the_records(tmp_path: Path) -> None:
    await filled(tmp_path)
    for _, key in [name for name in raw(tmp_path) if name[0] == STATISTICS]:
        rot(tmp_path, STATISTICS, key)
    async with open_store(world(), tmp_path, NODE) as store:
        before = await store.statistics()
        assert before.records == 3
        await store.put([put(4)])
        after = await store.statistics()
        assert (after.records, after.bytes) == (4, before.bytes + before.bytes // 3)
    async with open_store(world(), tmp_path, NODE) as store:
        assert (await store.statistics()).spaces == after.spaces


def date_back(folder: Path, version: int, *, is_plain: bool) -> None:
    """Make a folder one of an earlier format, with what lies in it."""
    now = raw(folder)
    number = version.to_bytes(4, "big")

    def change(transaction: WriteTransaction) -> None:
        for (table, key), value in now.items():
            transaction.put(table, key, value[:-4] if is_plain and table in SEALED else value)
        transaction.put(IDENTITY, b"format", number if is_plain else sealed(IDENTITY, b"format", number))

    with on_the_disk(folder) as environment:
        environment.update(change)


def forget_records(folder: Path) -> None:
    def change(transaction: WriteTransaction) -> None:
        for table in (RECORDS, OBJECTS, STATISTICS, DIGESTS):
            for key in list(transaction.keys(table, *EVERY_KEY)):
                transaction.delete(table, key)

    with on_the_disk(folder) as environment:
        environment.update(change)


OLDER = pytest.mark.parametrize(("version", "is_plain"), [(1, True), (2, True), (2, False)])


@OLDER
async def test_an_older_folder_without_records_goes_on_and_is_sealed_once(tmp_path: Path, version: int, is_plain: bool) -> None:
    await filled(tmp_path)
    forget_records(tmp_path)
    before = raw(tmp_path)
    date_back(tmp_path, version, is_plain=is_plain)
    async with open_store(world(), tmp_path, NODE) as store:
        assert store.identity.boot == 2
        assert await store.get_note("a note") == b"value"
        assert await store.headers() == {SceneId(SCENE): b"header"}
    changed = {name for name, value in raw(tmp_path).items() if before[name] != value}
    assert changed == {(IDENTITY, b"boot")}


@OLDER
async def test_records_of_an_earlier_version_are_said_to_be_such_and_not_touched(tmp_path: Path, version: int, is_plain: bool) -> None:
    await filled(tmp_path)
    date_back(tmp_path, version, is_plain=is_plain)
    before = raw(tmp_path)
    with pytest.raises(LocalFault, match="an earlier scenefold wrote") as caught:
        async with open_store(world(), tmp_path, NODE):
            pass
    assert not isinstance(caught.value, StoreDamaged)
    assert caught.value.where == str(tmp_path) and "import it again" in caught.value.remedy
    assert raw(tmp_path) == before
