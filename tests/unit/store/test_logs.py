"""If this fails, a node forgets what it has voted for, or a crash leaves a log and what follows from it at different positions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Slot, Value
from scenefold.store import LmdbDisk, Store, open_store
from scenefold.store.checking import Helps, check_store
from scenefold.store.layout import IDENTITY, LOGS, TABLES
from scenefold.store.lmdb_reading import looked_at
from scenefold.store.log_rows import POSITION_MAX, StoredLog, Votes, decided_key, votes_key
from scenefold.store.logs import Beside
from scenefold.world import WriteTransaction, offline_world
from scenefold.world.ports import DiskFull
from unit.store.log_samples import GENESIS, decided, slot
from unit.store.samples import NODE, SCENE, world
from unit.store.test_full_disk import TroubledDisk

OTHER = bytes(32)


async def decide(store: Store, *positions: int, silent_until: int = 0, beside: Beside | None = None) -> None:
    for position in positions:
        votes = Votes(store.identity.incarnation, position + 1, Slot(), silent_until)
        await store.put_decided(GENESIS, (decided(position),), votes, beside or Beside())


async def read(folder: Path, above: int = 0) -> StoredLog:
    async with open_store(world(), folder, NODE) as store:
        found = await store.read_log(GENESIS, above)
        assert found is not None
        return found


def change(folder: Path, work: Callable[[WriteTransaction], object]) -> None:
    with closing(LmdbDisk().open(folder, TABLES)) as environment:
        environment.update(work)


def rot(folder: Path, key: bytes) -> None:
    def turn(transaction: WriteTransaction) -> None:
        value = bytearray(transaction.get(LOGS, key) or b"")
        value[20] ^= 4
        transaction.put(LOGS, key, bytes(value))

    change(folder, turn)


@contextmanager
def findings(folder: Path) -> Iterator[list[tuple[str, Helps]]]:
    with looked_at(folder, TABLES) as raw:
        yield [(finding.where, finding.helps) for finding in check_store(raw).listed]


async def test_votes_and_decisions_are_there_after_opening_again(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.read_log(GENESIS) is None
        await store.put_votes(GENESIS, Votes(store.identity.incarnation, 1, slot()))
        await store.put_votes(OTHER, Votes(store.identity.incarnation, 1))
    assert await read(tmp_path) == StoredLog((), slot())
    async with open_store(world(), tmp_path, NODE) as store:
        before = store.commits
        await decide(store, 1, beside=Beside({SCENE: b"header"}, {SCENE: b"log"}, {"cluster-log": b"page"}))
        assert store.commits == before + 1, "one transaction"
        await decide(store, 2, 3)
        await store.put_votes(GENESIS, Votes(store.identity.incarnation, 4, slot()))
    assert await read(tmp_path) == StoredLog((decided(1), decided(2), decided(3)), slot())
    assert await read(tmp_path, above=2) == StoredLog((decided(3),), slot())
    async with open_store(world(), tmp_path, NODE) as store:
        assert (await store.get_header(SCENE), await store.get_scene_log(SCENE), await store.get_note("cluster-log")) == (
            b"header",
            b"log",
            b"page",
        )
        assert await store.read_log(OTHER) == StoredLog((), Slot())
        assert await store.decided(GENESIS, 0, 2, 1 << 20) == [decided(1), decided(2)]
        assert await store.decided(GENESIS, 1, 10, 1) == [decided(2)], "one at least"
        assert await store.decided(GENESIS, 3, 10, 1) == []
    with findings(tmp_path) as found:
        assert found == []


async def test_a_position_that_is_kept_otherwise_changes_with_the_next_one(tmp_path: Path) -> None:
    lean = decided(2)._replace(value=Value(decided(2).value.data))
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2)
        before = store.commits
        await store.put_decided(GENESIS, (lean, decided(3)), Votes(store.identity.incarnation, 4))
        assert store.commits == before + 1
    log = await read(tmp_path)
    assert [one.value.body for one in log.tail] == [b"", b"", b""] and decided(2).value.body
    assert log.tail[1].certificate == decided(2).certificate


async def test_on_a_full_disk_nothing_changes(tmp_path: Path) -> None:
    disk = TroubledDisk()
    async with open_store(offline_world(disk=disk), tmp_path, NODE) as store:
        await decide(store, 1, beside=Beside({SCENE: b"header 1"}))
        disk.trouble = DiskFull("no room")
        with pytest.raises(Refused) as refused:
            await decide(store, 2, beside=Beside({SCENE: b"header 2"}))
        assert refused.value.reason is RejectReason.STORAGE_FULL
        disk.trouble = None
        assert await store.read_log(GENESIS) == StoredLog((decided(1),), Slot())
        assert await store.get_header(SCENE) == b"header 1"


async def test_damaged_votes_silence_this_log_at_this_position_and_nothing_else(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2)
        await store.put_votes(GENESIS, Votes(store.identity.incarnation, 3, slot()))
        await store.put_votes(OTHER, Votes(store.identity.incarnation, 1, slot()))
    rot(tmp_path, votes_key(GENESIS))
    with findings(tmp_path) as found:
        assert found == [("votes of log 0001020304050607", Helps.FETCH)]
    log = await read(tmp_path)
    assert (log.tail, log.slot, log.silent_until) == ((decided(1), decided(2)), Slot(), 3)
    assert "changed" in log.damage[0]
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.read_log(OTHER) == StoredLog((), slot())
        await decide(store, 3, silent_until=3)
    assert await read(tmp_path) == StoredLog((decided(1), decided(2), decided(3)), Slot(), silent_until=3)


async def test_votes_that_are_gone_silence_it_too(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1)
    change(tmp_path, lambda transaction: transaction.delete(LOGS, votes_key(GENESIS)))
    assert (await read(tmp_path)).silent_until == 2
    with findings(tmp_path) as found:
        assert found == [("votes of log 0001020304050607", Helps.FETCH)]


@pytest.mark.parametrize("is_gone", [False, True])
async def test_a_shorter_log_is_silent_up_to_where_it_was(tmp_path: Path, is_gone: bool) -> None:
    """It has voted at 2 to 5 already, and does not know any more what for; also not once it has begun to learn it anew."""
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2, 3, 4)
        await store.put_votes(GENESIS, Votes(store.identity.incarnation, 5, slot()))
    if is_gone:
        change(tmp_path, lambda transaction: transaction.delete(LOGS, decided_key(GENESIS, 2)))
    else:
        rot(tmp_path, decided_key(GENESIS, 2))
    with findings(tmp_path) as found:
        assert found == [("log 0001020304050607, position 2", Helps.FETCH)]
    log = await read(tmp_path)
    assert (log.tail, log.slot, log.silent_until) == ((decided(1),), Slot(), 5)
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 2, silent_until=5)
    log = await read(tmp_path)
    assert (len(log.tail), log.slot, log.silent_until) == (4, Slot(), 5)
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 3, 4, 5, silent_until=5)
    log = await read(tmp_path)
    assert (len(log.tail), log.slot, log.silent_until, log.damage) == (5, Slot(), 5, ())


async def test_the_end_of_a_log_is_gone(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2, 3)
        await store.put_votes(GENESIS, Votes(store.identity.incarnation, 4, slot()))
    change(tmp_path, lambda transaction: transaction.delete(LOGS, decided_key(GENESIS, 3)))
    log = await read(tmp_path)
    assert (len(log.tail), log.slot, log.silent_until) == (2, Slot(), 4)


async def test_another_incarnation_is_bound_by_nothing_and_writes_nothing_for_the_one_before(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        before = store.identity.incarnation
        await decide(store, 1)
        await store.put_votes(GENESIS, Votes(before, 2, slot()))
        await store.renew_identity()
        with pytest.raises(Refused) as refused:
            await store.put_votes(GENESIS, Votes(before, 2))
        assert refused.value.reason is RejectReason.NOT_READY
    assert await read(tmp_path) == StoredLog((decided(1),), Slot())


async def test_logs_without_an_identity_are_no_new_folder(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1)

    def forget(transaction: WriteTransaction) -> None:
        for key in list(transaction.keys(IDENTITY, b"", b"\xff" * 16)):
            transaction.delete(IDENTITY, key)

    change(tmp_path, forget)
    with pytest.raises(LocalFault, match="logs but no identity"):
        async with open_store(world(), tmp_path, NODE):
            pass


async def test_a_key_that_names_no_log_is_deleted(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await store.put_header(SceneId(1), b"header")
    change(tmp_path, lambda transaction: transaction.put(LOGS, b"log", b"row"))
    with findings(tmp_path) as found:
        assert found == [(b"log".hex(), Helps.MEND)]


async def test_a_log_begins_behind_a_header_and_what_lies_before_is_passed_over(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2)
        before = store.commits
        await store.begin_log(GENESIS, Votes(store.identity.incarnation, 8), Beside({SCENE: b"header 7"}))
        assert store.commits == before + 1, "one transaction"
        assert await store.get_header(SCENE) == b"header 7"
        assert await store.read_log(GENESIS, 7) == StoredLog((), Slot())
        await decide(store, 8, 9)
        assert await store.read_log(GENESIS, 7) == StoredLog((decided(8), decided(9)), Slot())
        assert await store.decided(GENESIS, 2, 10, 1 << 20) == [], "nothing follows there"
        assert await store.kept_decisions(GENESIS, 1, 10, 1 << 20) == [decided(8), decided(9)]
        assert await store.kept_decisions(GENESIS, 1, 1, 1 << 20) == [decided(8)]
        assert await store.kept_decisions(GENESIS, 0, 9, 1) == [decided(8)], "one at least"
    with findings(tmp_path) as found:
        assert found == []
    rot(tmp_path, decided_key(GENESIS, 8))
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.kept_decisions(GENESIS, 0, 10, 1 << 20) == [decided(9)]
        await store.renew_identity()
        with pytest.raises(Refused):
            await store.begin_log(GENESIS, Votes(store.opened_as, 12), Beside())
        assert await store.kept_decisions(GENESIS, 0, 10, 1 << 20) == [decided(9)]


async def test_above_the_highest_position_there_is_nothing(tmp_path: Path) -> None:
    """Whoever asks what he lacks names a position, and may name any: there is none behind the last one to begin at."""
    async with open_store(world(), tmp_path, NODE) as store:
        await decide(store, 1, 2)
        for above in (2, POSITION_MAX - 1, POSITION_MAX):
            assert await store.decided(GENESIS, above, 10, 1 << 20) == []
            assert await store.kept_decisions(GENESIS, above, 10, 1 << 20) == []


async def test_the_names_of_all_logs_of_which_anything_is_kept(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.logs_kept() == frozenset()
        last = b"\xff" * 32
        for genesis in (GENESIS, OTHER, last):
            await store.put_votes(genesis, Votes(store.identity.incarnation, 1))
        await decide(store, *range(1, 5))
        assert await store.logs_kept() == {GENESIS, OTHER, last}


async def test_a_sealed_log_is_kept_only_with_its_own_header(tmp_path: Path) -> None:
    async with open_store(world(), tmp_path, NODE) as store:
        assert await store.scene_with_log(SCENE) is None
        assert not await store.keep_scene_log(SCENE, b"header", b"log")
        await store.put_header(SCENE, b"header")
        assert await store.scene_with_log(SCENE) is None
        assert await store.keep_scene_log(SCENE, b"header", b"log")
        assert await store.scene_with_log(SCENE) == (b"header", b"log")
        await decide(store, 1, beside=Beside({SCENE: b"header 2"}, {SCENE: b"log 2"}))
        assert not await store.keep_scene_log(SCENE, b"header", b"log")
        assert await store.scene_with_log(SCENE) == (b"header 2", b"log 2")
