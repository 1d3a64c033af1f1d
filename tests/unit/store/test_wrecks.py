"""If this failed, a bit that turned over in a stored header would let anybody roll an acknowledged record back, or replace it unseen."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.base.reasons import RejectReason
from scenefold.crypto import EXPECTS_NOTHING, HEADER_BYTES, Record
from scenefold.store import Outcome, Put
from scenefold.store.layout import HEADER_AT, RECORDS, Spot, pack_record, record_key
from scenefold.store.wrecks import judge_over_wreck
from unit.store.samples import NOWHERE, managed, object_id, place, record, whole_store, world
from unit.store.test_damage import rot

EPOCH_AT, SEQ_AT = HEADER_AT + 61, HEADER_AT + 69
THERE = record(1, seq=5, text=b"acknowledged")
NEXT = record(1, seq=6, text=b"next", expects=THERE.header.digest)
OLDER = record(1, seq=3, text=b"older")
NEWER = record(1, seq=6, text=b"newer")
CLAIM = record(1, seq=6, text=b"claim", expects=EXPECTS_NOTHING)
OTHER = record(1, seq=6, text=b"other", expects=NOWHERE)

SAID = pytest.mark.expect_log("changed on the disk")


def outcome(new: Record, *bits: int) -> Outcome:
    """Over what lies there, these bits of it turned over."""
    value = bytearray(pack_record(THERE))
    for bit in bits:
        value[bit // 8] ^= 1 << bit % 8
    return judge_over_wreck(new, memoryview(bytes(value))).outcome


def test_no_bit_of_sizes_header_or_signature_lets_a_compare_and_set_through_unseen() -> None:
    for bit in range(8 * (HEADER_AT + HEADER_BYTES + len(THERE.signature))):
        assert outcome(CLAIM, bit) is outcome(OTHER, bit) is Outcome.DAMAGED
        assert outcome(NEXT, bit) is Outcome.STORED, "the ciphertext is whole, and says which record it is"
        assert outcome(THERE, bit) is Outcome.STORED, "a retry"


def test_an_older_version_is_refused_unless_the_version_itself_has_rotted() -> None:
    version = range(8 * EPOCH_AT, 8 * (SEQ_AT + 8))
    beside = [bit for bit in range(8 * (HEADER_AT + HEADER_BYTES)) if bit not in version]
    taken = [bit for bit in beside if outcome(OLDER, bit) is Outcome.STORED]
    assert all(_unmakes_the_header(bit) for bit in taken)
    assert [bit - 8 * SEQ_AT for bit in version if outcome(OLDER, bit) is Outcome.STORED] == [8 * 7 + 2], "5 that has become 1"


def test_a_newer_version_heals_unless_what_is_there_looks_newer() -> None:
    refused = [bit for bit in range(8 * len(pack_record(THERE))) if outcome(NEWER, bit) is Outcome.DAMAGED]
    assert refused and all(8 * EPOCH_AT <= bit < 8 * (SEQ_AT + 8) for bit in refused)


def test_a_wreck_of_header_and_ciphertext_tells_nothing_to_compare_with() -> None:
    both = 8 * (HEADER_AT + 3), 8 * len(pack_record(THERE)) - 1
    assert outcome(NEXT, *both) is outcome(CLAIM, *both) is outcome(THERE, *both) is Outcome.DAMAGED
    assert outcome(NEWER, *both) is Outcome.STORED


def test_a_short_wreck_tells_nothing() -> None:
    for length in range(HEADER_AT + HEADER_BYTES):
        wreck = memoryview(pack_record(THERE)[:length])
        assert judge_over_wreck(CLAIM, wreck).outcome is judge_over_wreck(NEXT, wreck).outcome is Outcome.DAMAGED
        assert judge_over_wreck(NEWER, wreck).outcome is Outcome.STORED


def _unmakes_the_header(bit: int) -> bool:
    """Whether the bit is of a field that has few values: version, suite, placement, or a number with bounds."""
    at = bit // 8 - HEADER_AT
    return 0 <= at <= 2 or 39 <= at < 41 or 145 <= at < 149


@SAID
async def test_what_nobody_can_judge_is_refused_as_damaged_and_changes_nothing(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE)])
        before = await store.statistics()
    rot(tmp_path, RECORDS, record_key(place(1)), bit=8 * (HEADER_AT + 3))
    async with whole_store(world(), tmp_path) as store:
        for refused in (OLDER, CLAIM, OTHER):
            (result,) = await store.put([Put(refused)])
            assert (result.outcome, result.reason, result.has_changed) == (Outcome.DAMAGED, RejectReason.DAMAGED, False)
        assert (await store.statistics()).spaces == before.spaces
        (result,) = await store.put([Put(NEXT)])
        assert result.outcome is Outcome.STORED
        assert await store.get_many([place(1)]) == [NEXT]


@SAID
async def test_a_copy_heals_whatever_version_it_has(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE)])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=8 * (HEADER_AT + 3))
    async with whole_store(world(), tmp_path) as store:
        (result,) = await store.merge([Put(OLDER)])
        assert result.outcome is Outcome.STORED
        assert await store.get_many([place(1)]) == [OLDER]


@SAID
async def test_an_object_is_guarded_likewise(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        (stored,) = await store.put([Put(managed(5, seq=5))])
        assert stored.location is not None
    spot_key = record_key(place(0)._replace(location=stored.location), object_id(5))
    rot(tmp_path, RECORDS, spot_key, bit=8 * (HEADER_AT + 3))
    async with whole_store(world(), tmp_path) as store:
        outcomes = [(await store.put([Put(one)]))[0].outcome for one in (managed(5, seq=4, text=b"older"), managed(5, seq=5))]
        assert outcomes == [Outcome.DAMAGED, Outcome.STORED]


@SAID
async def test_who_repeats_what_is_refused_fills_no_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put([Put(THERE)])
    rot(tmp_path, RECORDS, record_key(place(1)), bit=8 * (HEADER_AT + 3))
    async with whole_store(world(), tmp_path) as store:
        caplog.clear()
        for _ in range(5):
            await store.put([Put(CLAIM)] * 2)
            await store.read([Spot(place(1))] * 2)
        assert sorted(line.getMessage().split(": ")[-1] for line in caplog.records) == [
            "a damaged record, whose header has changed on the disk, is in the way of another",
            "the header of a stored record has changed on the disk",
        ]
        assert all(place(1).location.hex() in line.getMessage() for line in caplog.records), "it says where"
        assert store.damaged == 1, "one record has rotted"
        assert store.noticed.is_rotten(Spot(place(1)))
        await store.merge([Put(THERE)])
        assert not store.noticed.is_rotten(Spot(place(1)))
