"""If this failed, stored bytes would mean something else to the next version, or ranges would lose their order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX
from scenefold.crypto import HEADER_BYTES
from scenefold.store import Outcome
from scenefold.store.layout import (
    STORED_BYTES_MAX,
    location_of,
    pack_record,
    record_key,
    sound_header,
    spot_of,
    stored_header,
    unpack_record,
)
from scenefold.store.wrecks import judge_over_wreck
from unit.store.samples import NOWHERE, place, record

NUMBERS = st.integers(0, (1 << 160) - 1)


def test_key_bytes() -> None:
    assert record_key(place(1, scene=0x01020304, space=0x0506)) == bytes.fromhex("01020304 0506") + bytes(19) + b"\x01"


@given(NUMBERS, NUMBERS)
def test_keys_are_ordered_as_the_line_is(one: int, other: int) -> None:
    assert (record_key(place(one)) < record_key(place(other))) == (one < other)
    assert location_of(record_key(place(one))).number == one


def test_a_record_survives_its_bytes() -> None:
    sample = record(3, size=1000)
    packed = memoryview(pack_record(sample))
    assert bytes(packed[:4]) == bytes([0x80, HEADER_BYTES, 0, 64])
    assert unpack_record(packed) == sample
    assert stored_header(packed) == sample.header


@pytest.mark.parametrize("kept", [0, 3, 100, HEADER_BYTES + 64 + 3])
def test_a_cut_record_is_damage(kept: int) -> None:
    with pytest.raises(DamagedData, match="shorter"):
        unpack_record(memoryview(pack_record(record(3))[:kept]))


def test_a_value_longer_than_any_record_is_damage_and_its_end_is_not_looked_at() -> None:
    """Where a bit of its size has turned over in the tree, it ends where there is no memory."""
    whole = pack_record(record(1, size=CIPHERTEXT_BYTES_MAX))
    assert unpack_record(memoryview(whole)) == record(1, size=CIPHERTEXT_BYTES_MAX)
    longer = memoryview(whole + bytes(STORED_BYTES_MAX))
    assert sound_header(longer) is None
    with pytest.raises(DamagedData, match="longer than any"):
        unpack_record(longer)
    assert judge_over_wreck(record(1, size=CIPHERTEXT_BYTES_MAX), longer).outcome is Outcome.STORED, "its header says so"
    assert judge_over_wreck(record(1, seq=2, expects=NOWHERE), longer).outcome is Outcome.DAMAGED


@given(st.integers(0, 8 + HEADER_BYTES + 64 + 64 - 1), st.integers(1, 255))
def test_no_changed_byte_is_taken_for_a_record(place_of_change: int, change: int) -> None:
    packed = bytearray(pack_record(record(3, size=64)))
    packed[place_of_change] ^= change
    with pytest.raises(DamagedData):
        unpack_record(memoryview(packed))


def test_a_changed_version_number_judges_nothing() -> None:
    packed = bytearray(pack_record(record(3)))
    packed[8 + 76] ^= 1
    with pytest.raises(DamagedData):
        stored_header(memoryview(packed))


def test_the_key_of_an_object_stands_behind_its_place() -> None:
    key = record_key(place(5), b"o" * 16)
    assert record_key(place(5)) < key < record_key(place(6))
    assert spot_of(key) == (place(5), b"o" * 16)
