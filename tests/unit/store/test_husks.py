"""If this failed, what is left of a record that rotted would replace a sound one, or a place where something was acknowledged would look empty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from scenefold.base.errors import DamagedData
from scenefold.base.location import WHOLE_LINE
from scenefold.crypto import Record
from scenefold.store import Outcome, Put, Spot, Store
from scenefold.store.layout import RECORDS, pack_record, record_key
from unit.store.samples import SCENE, SPACE, managed, object_id, place, record, whole_store, world
from unit.store.test_damage import rot

OLD, THERE, NEW = (record(1, seq=seq, text=b"%d" % seq) for seq in (4, 5, 6))
SPOT = Spot(place(1))
CIPHERTEXT_BIT = 8 * len(pack_record(THERE)) - 1
HEADER_BIT = 8 * 30

SAID = pytest.mark.expect_log("changed on the disk|lost")


def husk_of(whole: Record) -> Put:
    return Put(replace(whole, ciphertext=b""))


async def is_rotten(store: Store, spot: Spot = SPOT) -> bool:
    return isinstance((await store.read([spot]))[0], DamagedData)


def test_a_husk_is_what_has_no_ciphertext() -> None:
    assert husk_of(THERE).is_husk
    assert not Put(THERE).is_husk


@SAID
async def test_it_fills_an_empty_place_answers_as_damaged_and_is_healed_by_the_record(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        heard: list[Spot] = []
        store.tell_of_rot(heard.append)
        (kept,) = await store.merge([husk_of(THERE)])
        assert (kept.outcome, kept.has_changed) == (Outcome.STORED, True)
        assert (heard, store.damaged) == ([SPOT], 1)
        assert await is_rotten(store)
        assert await store.record_headers([SPOT]) == [THERE.header_bytes]
        with_husk = await store.sums(SCENE, SPACE, [WHOLE_LINE])
        assert [one.outcome for one in await store.put([Put(OLD)])] == [Outcome.STALE], "it is judged by what is left"
        (again,) = await store.merge([husk_of(THERE)])
        assert (again.outcome, again.has_changed) == (Outcome.STORED, False)
        assert [one.has_changed for one in await store.merge([Put(THERE)])] == [True]
        assert await store.get_many([place(1)]) == [THERE]
        assert not store.noticed.is_rotten(SPOT)
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == with_husk, "it counted as the version that it is of"


@pytest.mark.parametrize(("other", "outcome"), [(OLD, Outcome.DAMAGED), (THERE, Outcome.STORED), (NEW, Outcome.STALE)])
async def test_nothing_sound_is_replaced(tmp_path: Path, other: Record, outcome: Outcome) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(other)])
        (judged,) = await store.merge([husk_of(THERE)])
        assert (judged.outcome, judged.has_changed) == (outcome, False)
        assert await store.get_many([place(1)]) == [other]


@SAID
async def test_of_what_has_rotted_the_newer_is_kept_and_a_wreck_stays_as_it_is(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE), Put(record(2, seq=5))])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=CIPHERTEXT_BIT)
    rot(tmp_path, RECORDS, record_key(place(2)), bit=HEADER_BIT)
    async with whole_store(world(), tmp_path) as store:
        assert [one.outcome for one in await store.merge([husk_of(OLD)])] == [Outcome.STALE]
        assert [one.has_changed for one in await store.merge([husk_of(NEW)])] == [True]
        assert await store.record_headers([SPOT]) == [NEW.header_bytes]
        assert [one.has_changed for one in await store.merge([husk_of(record(2, seq=9))])] == [False]
        assert await store.record_headers([Spot(place(2))]) == [None]


@SAID
async def test_who_decides_about_a_place_has_it_take_a_wrecks(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE), Put(record(2, seq=5))])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=HEADER_BIT)
    async with whole_store(world(), tmp_path) as store:
        assert await is_rotten(store)
        decided = replace(husk_of(THERE), over_wreck=True)
        assert [one.has_changed for one in await store.merge([decided])] == [True]
        assert await store.record_headers([SPOT]) == [THERE.header_bytes]
        assert await is_rotten(store)
        sound = replace(husk_of(record(2, seq=9)), over_wreck=True)
        assert [one.outcome for one in await store.merge([sound])] == [Outcome.DAMAGED], "it replaces nothing that is sound"
        with_husk = await store.sums(SCENE, SPACE, [WHOLE_LINE])
        assert [one.has_changed for one in await store.merge([Put(THERE)])] == [True]
        assert await store.sums(SCENE, SPACE, [WHOLE_LINE]) == with_husk, "it counted once"
        assert not store.noticed.is_rotten(SPOT)


async def test_what_is_left_is_told_of_whatever_has_a_sound_header(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE), Put(record(2))])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=CIPHERTEXT_BIT)
    rot(tmp_path, RECORDS, record_key(place(2)), bit=HEADER_BIT)
    async with whole_store(world(), tmp_path) as store:
        assert await store.remains([SPOT, Spot(place(2)), Spot(place(3))]) == [replace(THERE, ciphertext=b""), None, None]


@SAID
async def test_an_object_is_known_wherever_it_lies(tmp_path: Path) -> None:
    whole = managed(5, seq=5)
    async with whole_store(world(), tmp_path) as store:
        await store.merge([husk_of(whole)])
        spot = Spot(place(0), object_id(5))
        assert await is_rotten(store, spot)
        (healed,) = await store.put([Put(whole)])
        assert healed.location == spot.home
        assert await store.read([spot]) == [whole]
        assert (await store.statistics()).records == 1


@SAID
@pytest.mark.parametrize(("over", "is_taken"), [(None, False), (NEW, False), (THERE, True)])
async def test_something_older_takes_the_place_of_just_the_version_that_it_is_to_replace(
    tmp_path: Path, over: Record | None, is_taken: bool
) -> None:
    async with whole_store(world(), tmp_path) as store:
        older = Put(OLD, instead_of=None if over is None else over.header)
        await store.put([Put(THERE)])
        assert [one.outcome for one in await store.merge([older])] == [Outcome.STALE], "what is sound stays"
    rot(tmp_path, RECORDS, record_key(place(1)), bit=CIPHERTEXT_BIT)
    async with whole_store(world(), tmp_path) as store:
        assert await is_rotten(store)
        (found,) = await store.merge([older])
        assert (found.outcome, found.has_changed) == (Outcome.STORED if is_taken else Outcome.STALE, is_taken)
        assert (await store.read([SPOT]) == [OLD]) is is_taken
        assert store.noticed.is_rotten(SPOT) is not is_taken
