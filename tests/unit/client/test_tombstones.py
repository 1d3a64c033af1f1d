"""If this fails, whoever stores a record can tell by its length that it is a deletion, or a deletion takes more room than it may."""

from __future__ import annotations

import secrets
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.tombstones import (
    MARK,
    PLACES_MAX,
    SEEN_MAX,
    TOMBSTONE_BYTES_MAX,
    UNKNOWN_BYTES_MAX,
    Key,
    Lengths,
    is_tombstone,
    tombstone,
)

FILES, SHAPES = SpaceId(10), SpaceId(11)
LARGE, UNKNOWN = 10**9, 10**9 + 1


def at(number: int, space: SpaceId = FILES) -> Key:
    return space, Location.from_number(number)


def of_length(length: int) -> bytes:
    return bytes(length)


@given(st.integers(len(MARK), TOMBSTONE_BYTES_MAX))
def test_a_deletion_is_as_long_as_what_it_replaces(length: int) -> None:
    lengths = Lengths()
    lengths.saw(at(1), of_length(length))
    payload = tombstone(lengths.of_deletion(at(1), secrets.token_bytes), secrets.token_bytes)
    assert is_tombstone(payload) and len(payload) == length
    assert not is_tombstone(of_length(length))


@given(st.lists(st.integers(0, 60_000), max_size=200), st.integers(0, 2**32))
def test_of_a_record_that_is_unknown_or_large_it_is_as_long_as_small_ones_of_its_space(sizes: list[int], seed: int) -> None:
    lengths, dice = Lengths(), Random(seed)
    for number, size in enumerate(sizes):
        lengths.saw(at(number), of_length(size))
        lengths.saw(at(number, SHAPES), of_length(77))
    lengths.saw(at(LARGE), of_length(60_000))
    small = [size for size in sizes if len(MARK) <= size <= TOMBSTONE_BYTES_MAX][-SEEN_MAX:]
    for place in (at(UNKNOWN), at(LARGE)):
        length = lengths.of_deletion(place, dice.randbytes)
        assert length in small if small else len(MARK) <= length < len(MARK) + UNKNOWN_BYTES_MAX


def test_where_every_record_has_one_length_so_has_every_deletion() -> None:
    lengths = Lengths()
    for number in range(100):
        lengths.saw(at(number), of_length(312))
    assert {lengths.of_deletion(at(place), secrets.token_bytes) for place in (1, 99, UNKNOWN)} == {312}


def test_what_is_remembered_is_bounded_and_the_last_counts() -> None:
    lengths = Lengths()
    for number in range(PLACES_MAX + 10):
        lengths.saw(at(number), of_length(100 if number < 10 else 200))
    assert len(lengths._places) == PLACES_MAX
    assert lengths.of_deletion(at(3), secrets.token_bytes) == 200, "forgotten, so it is one of the last 64"
    lengths.saw(at(LARGE), of_length(50))
    lengths.saw(at(LARGE), of_length(60))
    assert lengths.of_deletion(at(LARGE), secrets.token_bytes) == 60
    lengths.saw(at(LARGE), of_length(40_000))
    assert lengths.of_deletion(at(LARGE), secrets.token_bytes) <= TOMBSTONE_BYTES_MAX


def test_no_two_deletions_are_alike() -> None:
    assert tombstone(100, secrets.token_bytes) != tombstone(100, secrets.token_bytes)
    assert tombstone(len(MARK), secrets.token_bytes) == MARK


def test_a_node_managed_record_is_known_by_its_id_wherever_it_lies() -> None:
    lengths, object_id = Lengths(), b"o" * 16
    lengths.saw((FILES, Location.from_number(1), object_id), of_length(99))
    lengths.saw(at(1), of_length(500))
    assert lengths.of_deletion((FILES, Location.from_number(2), object_id), secrets.token_bytes) == 99
