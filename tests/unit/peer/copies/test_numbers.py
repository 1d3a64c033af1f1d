"""If this fails, one lie about numbers brings an owner to such as nobody may take from it, or a gap cannot be recovered."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.peer.copies.numbers import first_number, is_believed, is_possible

POSITIONS = st.integers(1, 2**31)


@given(POSITIONS, st.integers(0, 2**64 - 1), st.integers(1, 2**31))
def test_whoever_goes_on_above_what_it_believes_can_go_on_for_long(position: int, number: int, changes: int) -> None:
    if is_believed(number, position):
        assert is_possible(number + changes, position)
    elif is_possible(number, position):
        assert is_believed(number, position + 1), "at the latest when the log goes on"


@given(POSITIONS, st.integers(0, 2**64 - 1))
def test_who_adopts_after_a_removal_begins_above_all_that_was_possible(position: int, number: int) -> None:
    if is_possible(number, position):
        assert number < first_number(position + 1)
