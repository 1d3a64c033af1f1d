"""If this failed, a full or failing disk would lose what was acknowledged, or acknowledge what is lost."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.limits import STORE_RESERVE_BYTES
from scenefold.base.reasons import RejectReason
from scenefold.client.tombstones import TOMBSTONE_BYTES_MAX, tombstone
from scenefold.crypto import EXPECTS_NOTHING, Record
from scenefold.store import LmdbDisk, Outcome, Put, open_store
from scenefold.store.changes import PutValue
from scenefold.store.holding import PutHolding, read_arc
from scenefold.store.layout import RECORDS, TABLES, pack_record, record_key
from scenefold.store.lmdb_transaction import TREE_PAGES_MAX
from scenefold.store.preallocation import AHEAD_BYTES_MIN
from scenefold.store.record_changes import DELETION_BYTES_MAX, HoldRecords, MergeRecords, PutRecords
from scenefold.store.statistics import capacity_of
from scenefold.store.writer import commit
from scenefold.world import DiskFailed, DiskFull, Environment, offline_world
from unit.store.samples import NODE, NOWHERE, SCENE, arc, managed, place, put, record, whole_store, world
from unit.store.test_damage import rot

FILLING = """
import resource, signal, sys
from pathlib import Path
import trio
sys.path.insert(0, {tests!r})
from scenefold.store import Outcome
from unit.store.samples import place, put, record, whole_store, world

async def main():
    async with whole_store(world(map_bytes=1 << 18), Path({folder!r}), reserve_bytes=0) as store:
        outcomes = []
        for number in range(200):
            [result] = await store.put([put(number, size=60_000)])
            outcomes.append(result.outcome)
        full = outcomes.index(Outcome.FULL)
        assert full > 20 and Outcome.STORED not in outcomes[full + 5:], outcomes
        for number in range(full):
            assert await store.get_many([place(number)]) == [record(number, size=60_000)]
        print(full, flush=True)

# What the kernel answers at this limit stands for a full disk; the signal that comes with it would end us.
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (4 << 20, 4 << 20))
trio.run(main)
"""


def fill(folder: Path) -> int:
    """Put records until there is no room; how many were acknowledged."""
    script = FILLING.format(tests=str(Path(__file__).parents[2]), folder=str(folder))
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr
    return int(result.stdout)


async def test_when_the_file_cannot_grow(tmp_path: Path) -> None:
    full = fill(tmp_path)
    async with whole_store(world(), tmp_path) as store:
        assert await store.get_many([place(number) for number in range(full)]) == [record(number, size=60_000) for number in range(full)]
        [again] = await store.put([put(500)])
        assert again.outcome is Outcome.STORED


class TroubledDisk:
    """LMDB whose next update fails as told, after the change has been applied but before it is durable."""

    def __init__(self) -> None:
        self.trouble: Exception | None = None
        self._disk = LmdbDisk()

    def open(self, folder: Path, tables: Sequence[str], /) -> Environment:
        environment = self._disk.open(folder, tables)
        update = environment.update

        def troubled(change: Callable[[Any], Any]) -> Any:
            def and_fail(transaction: Any) -> Any:
                result = change(transaction)
                if self.trouble is not None:
                    raise self.trouble
                return result

            return update(and_fail)

        environment.update = troubled  # type: ignore[method-assign]
        return environment


@pytest.mark.expect_log("new records are refused")
async def test_a_full_disk_acknowledges_nothing(tmp_path: Path) -> None:
    disk = TroubledDisk()
    async with whole_store(offline_world(disk=disk), tmp_path) as store:
        disk.trouble = DiskFull("no room at all")
        results = await store.put([put(1), put(2)])
        assert [result.outcome for result in results] == [Outcome.FULL] * 2
        with pytest.raises(Refused) as caught:
            await store.put_header(SCENE, b"x")
        assert caught.value.reason is RejectReason.STORAGE_FULL
        disk.trouble = None
        assert await store.get_many([place(1)]) == [None]
        assert (await store.statistics()).records == 0
        [result] = await store.put([put(1)])
        assert result.outcome is Outcome.STORED


@pytest.mark.expect_log("the disk is on fire")
async def test_a_failing_disk_stops_the_node(tmp_path: Path) -> None:
    disk = TroubledDisk()

    async def use_it() -> None:
        async with whole_store(offline_world(disk=disk), tmp_path) as store:
            disk.trouble = DiskFailed("the disk is on fire")
            with pytest.raises(Refused):
                await store.put([put(1)])
            await trio.sleep_forever()

    with pytest.raises(LocalFault, match="on fire"):
        await use_it()
    async with whole_store(world(), tmp_path) as store:
        assert await store.get_many([place(1)]) == [None]


FULL = 1 << 60
"""A reserve that no disk has."""


async def outcomes_when_full(folder: Path, puts: Sequence[Put]) -> list[Outcome]:
    async with open_store(world(), folder, NODE, reserve_bytes=FULL) as store:
        return [result.outcome for result in await store.put(puts)]


@pytest.mark.expect_log("full but for its reserve")
async def test_what_is_there_is_acknowledged_again_when_the_disk_has_filled_up(tmp_path: Path) -> None:
    """Its first answer may have been lost, and its writer would take a refusal for the truth."""
    written = put(1, seq=5, expects=EXPECTS_NOTHING)
    async with whole_store(world(), tmp_path) as store:
        await store.put([written])
    asked = [
        written,
        put(1, seq=5, expects=NOWHERE),
        put(1, seq=4),
        put(1, seq=6, expects=NOWHERE),
        put(1, seq=6, size=5_000),
        put(2),
        put(2, expects=NOWHERE),
    ]
    wanted = [Outcome.STORED, Outcome.EXISTS, Outcome.STALE, Outcome.EXISTS, Outcome.FULL, Outcome.FULL, Outcome.EXISTS]
    assert await outcomes_when_full(tmp_path, asked) == wanted
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.get_many([place(1), place(2)]) == [written.record, None]
        await store.put_holding(arc(2, 9), b"")
    assert await outcomes_when_full(tmp_path, [written, put(2)]) == [Outcome.NOT_OWNED, Outcome.FULL]


@pytest.mark.expect_log("full but for its reserve")
async def test_what_is_there_is_acknowledged_again_when_the_commit_has_no_room(tmp_path: Path) -> None:
    """A repetition waits in the same batch as what makes the disk full."""
    disk = TroubledDisk()
    async with whole_store(offline_world(disk=disk), tmp_path) as store:
        await store.put([put(1)])
        disk.trouble = DiskFull("no room at all")
        assert [result.outcome for result in await store.put([put(2), put(1)])] == [Outcome.FULL, Outcome.STORED]
        disk.trouble = None
        assert await store.get_many([place(1), place(2)]) == [record(1), None]


@pytest.mark.expect_log("full but for its reserve")
async def test_an_object_that_is_there_is_acknowledged_again_and_where_it_lies(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        [first] = await store.put([Put(managed(1))])
    async with open_store(world(), tmp_path, NODE, reserve_bytes=FULL) as store:
        again, newer, other = await store.put([Put(managed(1)), Put(managed(1, seq=2, size=5_000)), Put(managed(2))])
        assert again == first
        assert again.location is not None
        assert [newer.outcome, other.outcome] == [Outcome.FULL] * 2
        assert (await store.statistics()).records == 1


@pytest.mark.expect_log("full but for its reserve")
async def test_what_has_rotted_is_acknowledged_again_only_if_it_could_be_written_anew(tmp_path: Path) -> None:
    disk = TroubledDisk()
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=8 * 300)
    async with open_store(offline_world(disk=disk), tmp_path, NODE, reserve_bytes=FULL) as store:
        disk.trouble = DiskFull("not a byte")
        assert [result.outcome for result in await store.put([put(1)])] == [Outcome.FULL]
        disk.trouble = None
        assert [result.outcome for result in await store.put([put(1)])] == [Outcome.STORED]
        assert await store.get_many([place(1)]) == [record(1)]


@pytest.mark.expect_log("full but for its reserve")
@pytest.mark.parametrize("made", [record, managed])
async def test_what_replaces_a_record_and_is_no_larger_is_taken_by_a_full_disk(tmp_path: Path, made: Callable[..., Record]) -> None:
    """A deletion is one: nodes cannot tell it from any other record."""
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(made(1, size=6_000)), Put(made(2, size=6_000))])
    async with open_store(world(), tmp_path, NODE, reserve_bytes=FULL) as store:
        asked = [made(1, seq=2, size=6_000), made(1, seq=3, size=20), made(1, seq=4, size=5_000), made(2, seq=2, size=6_001), made(3)]
        results = await store.put([Put(one) for one in asked])
        assert [result.outcome.name for result in results] == ["STORED", "STORED", "FULL", "FULL", "FULL"]
        statistics = await store.statistics()
        assert statistics.records == 2
        assert statistics.bytes == sum(len(pack_record(one)) for one in (asked[1], made(2, size=6_000)))
    async with open_store(world(), tmp_path, NODE) as store:
        again, after = await store.put([Put(asked[1]), Put(asked[2])])
        assert [again.outcome, after.outcome] == [Outcome.STORED] * 2
        assert again.location == results[0].location == results[1].location


class NearlyFull(TroubledDisk):
    """LMDB that says how much is left, and has all the room in truth."""

    left_bytes = 0

    def open(self, folder: Path, tables: Sequence[str], /) -> Environment:
        environment = super().open(folder, tables)
        space = environment.space
        environment.space = lambda: space()._replace(free=self.left_bytes, reusable=0)  # type: ignore[method-assign]
        return environment


@pytest.mark.expect_log("full but for its reserve")
async def test_a_deletion_may_be_larger_than_what_it_deletes_while_half_of_what_is_taken_ahead_is_left(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, size=20), put(2, size=20)])
    smaller, larger = put(1, seq=2, size=2_100), put(2, seq=2, size=DELETION_BYTES_MAX)
    disk = NearlyFull()
    for disk.left_bytes, wanted in [(AHEAD_BYTES_MIN // 2, "FULL"), (AHEAD_BYTES_MIN // 2 + 1, "STORED")]:
        async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
            assert [result.outcome.name for result in await store.put([smaller, larger, put(3)])] == [wanted, "FULL", "FULL"]


HOLDING_ENDS = 3 * AHEAD_BYTES_MIN // 4
"""With so much left nothing new is held for others any more, and deletions still have a quarter for themselves."""


def held_bytes(copy: Put) -> int:
    return HoldRecords([(copy.record.header, copy)]).size_bytes


@pytest.mark.expect_log("full but for its reserve")
async def test_copies_for_others_leave_deletions_what_they_need(tmp_path: Path) -> None:
    """Else a node that is full could not even delete any more, since it held so much for others; and nothing else makes room."""
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, size=20), put(2, seq=2, size=6_000)])
    disk, new = NearlyFull(), put(9, size=60_000)
    disk.left_bytes = HOLDING_ENDS + held_bytes(new)
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        assert [result.outcome.name for result in await store.hold([new])] == ["STORED"]
    disk.left_bytes = HOLDING_ENDS
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        copies = [put(3), new, put(9, seq=2, size=60_001), put(2, size=7_000), put(2, seq=3, size=6_000), put(2, seq=4)]
        wanted = ["FULL", "STORED", "FULL", "STALE", "STORED", "STORED"]
        assert [result.outcome.name for result in await store.hold(copies)] == wanted
        assert await store.get_many([place(3), place(9), place(2)]) == [None, new.record, copies[-1].record]
        assert [result.outcome.name for result in await store.hold([put(1, seq=2, size=2_100)])] == ["STORED"], "a deletion of the owner's"
        assert [result.outcome.name for result in await store.put([put(1, seq=3, size=2_200)])] == ["STORED"], "a deletion"
        assert [result.outcome.name for result in await store.merge([put(3)])] == ["STORED"], "of its own arc"


MERGING_ENDS = 5 * AHEAD_BYTES_MIN // 8
"""With so much left nothing new is recovered, brought home or compared any more, and deletions still have an eighth for themselves."""


@pytest.mark.expect_log("full but for its reserve")
async def test_what_is_recovered_leaves_the_reserve_to_who_makes_room(tmp_path: Path) -> None:
    """A gap of many times the reserve would else take all of it: then nothing can be deleted, given away, or noted any more."""
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, size=20), put(2, seq=2, size=6_000)])
    disk, new = NearlyFull(), put(9, size=60_000)
    disk.left_bytes = MERGING_ENDS + held_bytes(new)
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        assert [result.outcome.name for result in await store.hold([put(3)])] == ["FULL"]
        assert [result.outcome.name for result in await store.merge([new])] == ["STORED"], "what others have held here keeps no gap"
    disk.left_bytes = MERGING_ENDS
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        copies = [put(3), new, put(9, seq=2, size=60_001), put(2, size=7_000), put(2, seq=3, size=6_000)]
        wanted = ["FULL", "STORED", "FULL", "STALE", "STORED"]
        assert [result.outcome.name for result in await store.merge(copies)] == wanted
        assert [result.outcome.name for result in await store.merge([put(1, seq=2, size=2_100)])] == ["STORED"], "a deletion elsewhere"
        assert [result.outcome.name for result in await store.put([put(1, seq=3, size=2_200)])] == ["STORED"], "a deletion"
        await store.put_holding(arc(0, 5), b"note")
        await store.put_header(SCENE, b"x")


async def test_what_has_rotted_is_healed_by_a_disk_that_takes_nothing_new(tmp_path: Path) -> None:
    """It is no larger. What is larger than what rotted is refused for want of room, and so is asked for again."""
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, seq=3, size=6_000), put(2, seq=3, size=6_000)])
    for number in (1, 2):
        rot(tmp_path, RECORDS, record_key(place(number)), bit=8 * 300)
    disk = NearlyFull()
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        rotten = put(2, seq=3, size=6_000).record.header
        older = [replace(put(2, seq=1, size=size), instead_of=rotten) for size in (7_000, 5_000)]
        results = await store.merge([put(1, seq=3, size=6_000), *older])
        assert [result.outcome.name for result in results] == ["STORED", "FULL", "STORED"]
        assert await store.get_many([place(1), place(2)]) == [record(1, seq=3, size=6_000), older[1].record]


def test_what_makes_room_is_done_though_it_shares_a_commit_with_what_has_none(tmp_path: Path) -> None:
    """How much room there is nobody knows beforehand: others write to the disk as well."""
    room_bytes = 100_000

    class Small(NearlyFull):
        def open(self, folder: Path, tables: Sequence[str], /) -> Environment:
            environment = super().open(folder, tables)
            update = environment.update

            def bounded(change: Callable[[Any], Any]) -> Any:
                def counted(transaction: Any) -> Any:
                    result = change(transaction)
                    if transaction.dirty_bytes_max > room_bytes + 40 * 4096 * TREE_PAGES_MAX:
                        raise DiskFull("no room for so much")
                    return result

                return update(counted)

            environment.update = bounded  # type: ignore[method-assign]
            return environment

    disk = Small()
    disk.left_bytes = 1 << 40
    environment = disk.open(tmp_path, TABLES)
    first = commit(environment, [PutHolding(b"", arc(0, 9), b""), MergeRecords([(put(1).record.header, put(1))])], STORE_RESERVE_BYTES)
    assert first.answers[1][0].outcome is Outcome.STORED
    large = [put(10 + number, size=60_000) for number in range(30)]
    gone = put(1, seq=2, size=1)
    changes = [
        MergeRecords([(copy.record.header, copy) for copy in large]),
        PutHolding(b"", arc(0, 5), b"given"),
        PutRecords([(gone.record.header, gone)]),
        PutRecords([(put(3).record.header, put(3))]),
        PutValue("headers", b"abcd", b"header"),
    ]
    found = commit(environment, changes, STORE_RESERVE_BYTES)
    merged, _, deleted, added, _ = found.answers
    assert {result.outcome for result in merged} == {Outcome.FULL}
    assert [result.outcome for result in (*deleted, *added)] == [Outcome.STORED, Outcome.FULL]
    assert found.refused == len(changes)
    with environment.read() as view:
        assert read_arc(view) == arc(0, 5)
        assert view.get("headers", b"abcd") is not None
    environment.close()


def test_copies_for_others_that_share_a_commit_do_not_take_more_together(tmp_path: Path) -> None:
    disk, copies = NearlyFull(), [put(number, size=60_000) for number in range(5)]
    disk.left_bytes = HOLDING_ENDS + 5 * held_bytes(copies[0]) // 2
    environment = disk.open(tmp_path, TABLES)
    changes = [HoldRecords([(copy.record.header, copy)]) for copy in copies]
    answers = commit(environment, changes, STORE_RESERVE_BYTES).answers
    assert [result.outcome.name for (result,) in answers] == ["STORED"] * 2 + ["FULL"] * 3
    environment.close()


def test_a_deletion_fits_where_deletions_may_be_larger_than_what_they_delete() -> None:
    assert len(tombstone(TOMBSTONE_BYTES_MAX, bytes)) == TOMBSTONE_BYTES_MAX < DELETION_BYTES_MAX - 1024


async def test_a_store_that_refuses_new_records_is_full_in_its_own_words(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1)])
        roomy = await store.statistics()
    async with open_store(world(), tmp_path, NODE, reserve_bytes=FULL) as store:
        full = await store.statistics()
    assert 0 < full.disk_used_bytes == full.disk_total_bytes < roomy.disk_total_bytes
    assert capacity_of(full, 1 << 50) == full.disk_used_bytes, "a share of the disk promises no room"
    assert capacity_of(roomy, 1 << 16) == 1 << 16


@pytest.mark.expect_log("full but for its reserve|changed on the disk")
@pytest.mark.parametrize("reserve", [0, FULL], ids=["room", "full"])
async def test_what_is_expected_is_judged_alike_with_room_and_without(tmp_path: Path, reserve: int) -> None:
    """Of a rotten record the header is there still, and says which version it is: its writer must not hear that another one is.

    Of one whose header has rotted, the ciphertext.
    """
    before = record(1, seq=5).header.digest
    async with whole_store(world(), tmp_path) as store:
        await store.put([put(1, seq=5), put(2, seq=5)])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=8 * 300)
    rot(tmp_path, RECORDS, record_key(place(2)), bit=8 * 10)
    asked = [
        put(1, seq=6, expects=NOWHERE),
        put(1, seq=6, expects=EXPECTS_NOTHING),
        put(1, seq=4),
        put(1, seq=5),
        put(1, seq=6, text=b"new", expects=before),
        put(2, seq=6, text=b"other", expects=NOWHERE),
        put(2, seq=6, text=b"claim", expects=EXPECTS_NOTHING),
        put(2, seq=6, text=b"new", expects=before),
    ]
    # What takes the place of a record, and is no larger, may use the reserve. So may what heals one.
    written = Outcome.STORED
    wanted = [Outcome.EXISTS, Outcome.EXISTS, Outcome.STALE, written, written, Outcome.DAMAGED, Outcome.DAMAGED, written]
    async with open_store(world(), tmp_path, NODE, reserve_bytes=reserve) as store:
        assert [result.outcome for result in await store.put(asked)] == wanted
