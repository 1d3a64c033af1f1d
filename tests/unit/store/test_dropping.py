"""If this failed, a purge would take more than what was deleted, or leave a way back for what is older."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import trio
import trio.testing
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE
from scenefold.crypto import Record, RecordPlace, version_key
from scenefold.store import Outcome, Put, RangeSum, Spot, bygone, version_of
from scenefold.store.bygone import BYGONE_S, Bygone
from unit.store.samples import SCENE, SPACE, managed, object_id, place, put, record, whole_store, world

OWED = NodeId(9)


def spot(number: int) -> Spot:
    return Spot(place(number))


def object_spot(number: int, at: int = 0) -> Spot:
    return Spot(RecordPlace(SCENE, SPACE, place(at).location), object_id(number))


def version(kept: Record) -> bytes:
    return version_of(kept.header_bytes)


async def test_exactly_the_version_that_is_named_goes_and_all_that_is_derived_of_it(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        records = [record(number) for number in (1, 2, 3)]
        await store.put([Put(one) for one in records], debtors=[[OWED]] * 3)
        newer = record(2, seq=2)
        await store.put([Put(newer)])
        named = [(spot(number), version(one)) for number, one in zip((1, 2, 3), records, strict=True)]
        assert await store.drop([*named[:2], (spot(3), bytes(32)), (spot(4), version(records[0]))]) == 1
        assert await store.get_many([place(number) for number in (1, 2, 3, 4)]) == [None, newer, records[2], None]
        (total,) = await store.sums(SCENE, SPACE, [WHOLE_LINE])
        assert (total.records, store.record_count, store.owed) == (2, 2, {OWED: 1})
        assert await store.drop(named[:2]) == 0
        assert await store.drop([(spot(2), version(newer)), named[2]]) == 2
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == [RangeSum()]
        assert store.owed == {}


async def test_one_version_is_not_taken_for_another_with_the_same_bytes(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        older, newer = record(1, text=b"alike"), record(1, text=b"alike", seq=2)
        assert older.header.digest == newer.header.digest
        await store.put([Put(newer)])
        assert await store.drop([(spot(1), version(older))]) == 0
        assert await store.get_many([place(1)]) == [newer]


async def test_an_object_goes_wherever_it_lies(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        kept = managed(5)
        await store.merge([Put(kept, at=place(77).location)])
        assert await store.drop([(object_spot(5), version(kept))]) == 1
        assert await store.read([object_spot(5)]) == [None]


async def test_nothing_older_than_what_is_marked_is_taken_and_all_else_is(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        deleted = record(1, seq=5)
        await store.put([Put(deleted)])
        assert store.mark_bygone([(spot(1), version_key(deleted.header))])
        assert await store.drop([(spot(1), version(deleted))]) == 1
        late = await store.merge([put(1, seq=4), put(2, seq=1), put(1, seq=3)])
        assert [result.outcome for result in late] == [Outcome.STALE, Outcome.STORED, Outcome.STALE]
        assert [result.outcome for result in await store.put([put(1, seq=4)])] == [Outcome.STALE]
        assert await store.get_many([place(1)]) == [None]
        # The deleted record itself does no harm: it is purged another time.
        assert [result.outcome for result in await store.merge([Put(deleted)])] == [Outcome.STORED]
        assert [result.outcome for result in await store.put([put(1, seq=6)])] == [Outcome.STORED]


async def test_an_older_object_is_not_taken_at_any_place(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        store.mark_bygone([(object_spot(5, at=3), version_key(managed(5, seq=2).header))])
        (result,) = await store.merge([Put(managed(5), at=place(77).location)])
        assert result.outcome is Outcome.STALE
        (result,) = await store.merge([Put(managed(5, seq=2), at=place(77).location)])
        assert result.outcome is Outcome.STORED


async def test_what_was_given_to_the_store_before_the_mark_is_there_after_a_flush(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store, trio.open_nursery() as nursery:
        for number in range(40):
            nursery.start_soon(store.merge, [put(number)])
        # All of them have called, and wait.
        await trio.testing.wait_all_tasks_blocked(0.0)
        store.mark_bygone([(spot(number), version_key(record(number, seq=2).header)) for number in range(40)])
        await store.flush()
        assert None not in await store.get_many([place(number) for number in range(40)])


async def test_the_mark_is_over_with_the_store(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        store.mark_bygone([(spot(1), version_key(record(1, seq=5).header))])
    async with whole_store(world(), tmp_path) as store:
        (result,) = await store.merge([put(1)])
        assert result.outcome is Outcome.STORED


def test_marks_are_forgotten_only_when_they_are_old_and_others_need_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bygone, "BYGONE_MAX", 3)
    at = 0.0
    marks = Bygone(lambda: at)
    versions = {number: version_key(record(number, seq=2).header) for number in range(9)}
    assert marks.mark([(spot(number), versions[number]) for number in (0, 1)])
    at = 1.0
    assert marks.mark([(spot(2), versions[2])])
    assert marks.mark([(spot(0), versions[0])]), "this one is there already, and from now on the newest"
    assert not marks.mark([(spot(3), versions[3])])
    assert marks.late([put(number) for number in range(4)]).keys() == {0, 1, 2}
    at = BYGONE_S
    assert marks.mark([(spot(3), versions[3])])
    assert marks.late([put(number) for number in range(4)]).keys() == {0, 2, 3}
    assert not marks.mark([(spot(number), versions[number]) for number in (4, 5)])


class Sleeper:
    """The clock of a machine that sleeps for an hour whenever somebody looks. The time that connections go by stands still meanwhile."""

    at = 0.0

    def now(self) -> float:
        self.at += 3600.0
        return self.at

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


async def test_a_machine_that_sleeps_forgets_no_mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was on its way when it fell asleep comes when it wakes."""
    monkeypatch.setattr(bygone, "BYGONE_MAX", 1)
    async with whole_store(replace(world(), clock=Sleeper()), tmp_path) as store:
        assert store.bygone.mark([(spot(1), version_key(record(1, seq=2).header))])
        assert not store.bygone.mark([(spot(2), version_key(record(2, seq=2).header))])
        assert [result.outcome for result in await store.put([put(1)])] == [Outcome.STALE]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(1, 4)), max_size=12), st.integers(0, 3), st.integers(1, 4))
@settings(max_examples=60, deadline=None)
def test_a_mark_never_goes_down(marked: list[tuple[int, int]], number: int, seq: int) -> None:
    marks = Bygone(lambda: 0.0)
    for where, what in marked:
        assert marks.mark([(spot(where), version_key(record(where, seq=what).header))])
    highest = max((what for where, what in marked if where == number), default=0)
    assert bool(marks.late([put(number, seq=seq)])) == (seq < highest)
    assert marks.is_marked(spot(number), version_key(record(number, seq=seq).header)) == (seq == highest)
