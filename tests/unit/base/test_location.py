"""If this fails, two floors mean different places by the same bytes, or the line has holes."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.location import (
    FIRST,
    LAST,
    LINE_LENGTH,
    WHOLE_LINE,
    Arc,
    Location,
    arcs_between,
    even_right_bounds,
    tiles,
)

numbers = st.one_of(st.integers(0, LINE_LENGTH - 1), st.sampled_from([0, 1, LINE_LENGTH - 2, LINE_LENGTH - 1]))
locations = numbers.map(Location.from_number)
arcs = st.tuples(locations, locations).map(lambda ends: Arc(min(ends), max(ends)))


@given(numbers, numbers)
def test_bytes_are_ordered_as_numbers_are(one: int, other: int) -> None:
    left, right = Location.from_number(one), Location.from_number(other)
    assert left.number == one and len(left) == 20
    assert (left < right, left == right) == (one < other, one == other)


@given(numbers)
def test_stripped_zeros_come_back(number: int) -> None:
    location = Location.from_number(number)
    assert Location.from_padded(bytes(location).rstrip(b"\0")) == location


@given(numbers)
def test_next_is_one_further(number: int) -> None:
    following = Location.from_number(number).next()
    assert (following is None) if number == LINE_LENGTH - 1 else (following is not None and following.number == number + 1)


def test_ends_of_the_line() -> None:
    assert (FIRST.number, LAST.number) == (0, LINE_LENGTH - 1)
    assert LAST.next() is None and WHOLE_LINE.length == LINE_LENGTH


@pytest.mark.parametrize("value", [b"", b"x" * 19, b"x" * 21])
def test_a_location_has_20_bytes(value: bytes) -> None:
    with pytest.raises(ValueError, match="20 bytes"):
        Location(value)


def test_what_is_too_long_to_pad_is_refused() -> None:
    with pytest.raises(ValueError, match="20 bytes"):
        Location.from_padded(b"x" * 21)


@pytest.mark.parametrize("number", [-1, LINE_LENGTH])
def test_numbers_off_the_line(number: int) -> None:
    with pytest.raises(ValueError, match="outside the line"):
        Location.from_number(number)


def test_repr_shows_the_bytes() -> None:
    assert repr(Location.from_number(255)) == f"Location({'00' * 19}ff)"


@given(locations, locations)
def test_an_arc_never_wraps(one: Location, other: Location) -> None:
    if one > other:
        with pytest.raises(ValueError, match="ends at or after"):
            Arc(one, other)
    else:
        assert Arc(one, other).length == other.number - one.number + 1


@given(arcs, arcs, locations)
def test_intersection_holds_what_both_hold(one: Arc, other: Arc, location: Location) -> None:
    common = one.intersection(other)
    assert common == other.intersection(one)
    for place in (location, one.first, one.last, other.first, other.last):
        assert (place in one and place in other) == (common is not None and place in common)


@given(st.integers(1, 300))
def test_even_bounds_tile_the_line(count: int) -> None:
    bounds = even_right_bounds(count)
    pieces = arcs_between(bounds)
    assert len(pieces) == count and pieces[0].first == FIRST and pieces[-1].last == LAST
    assert all(left.last.number + 1 == right.first.number for left, right in itertools.pairwise(pieces))
    assert sum(piece.length for piece in pieces) == LINE_LENGTH
    lengths = {piece.length for piece in pieces}
    assert max(lengths) - min(lengths) <= 1


@given(st.lists(locations, unique=True, max_size=10).map(sorted))
def test_any_ascending_bounds_tile_the_line(bounds: list[Location]) -> None:
    pieces = arcs_between([*(bound for bound in bounds if bound != LAST), LAST])
    assert sum(piece.length for piece in pieces) == LINE_LENGTH
    assert all(left.last.next() == right.first for left, right in itertools.pairwise(pieces))


def test_bounds_that_are_none() -> None:
    with pytest.raises(ValueError, match="at least one owner"):
        even_right_bounds(0)
    for bounds in ([], [FIRST]):
        with pytest.raises(ValueError, match="end of the line"):
            arcs_between(bounds)
    with pytest.raises(ValueError, match="ends at or after"):
        arcs_between([Location.from_number(9), Location.from_number(3), LAST])


@given(st.integers(1, 9), st.randoms(use_true_random=False), st.integers(0, 8))
def test_arcs_tile_the_line_or_one_of_them_lacks_or_is_too_much(count: int, dice: random.Random, which: int) -> None:
    pieces = arcs_between(even_right_bounds(count))
    dice.shuffle(pieces)
    assert tiles(pieces)
    one = pieces[which % count]
    assert not tiles([piece for piece in pieces if piece != one])
    assert not tiles([*pieces, one])
