"""If this fails, a newer record loses against an older one, or two atoms of an import want the same place."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.client import free_places
from scenefold.client.free_places import FreePlaces
from scenefold.client.versions import AHEAD_S_MAX, SEQ_MAX, Sequencer

SPACE = SpaceId(2)


@given(st.lists(st.one_of(st.floats(0, 4e9), st.integers(0, 2**64 - 1)), max_size=30))
def test_numbers_rise_whatever_the_clock_does_and_whatever_is_read(happenings: list[float | int]) -> None:
    sequencer, last = Sequencer(), -1
    for happening in happenings:
        if isinstance(happening, int):
            sequencer.saw(happening, 1e9)
            if happening <= 1e15:
                last = max(last, happening)
        else:
            number = sequencer.next(happening)
            assert number > last
            last = number


def test_a_number_of_no_clock_leads_no_other_record_astray() -> None:
    sequencer, now = Sequencer(), 1e9
    sequencer.saw(int((now + AHEAD_S_MAX) * 1e6), now)
    assert sequencer.next(now) == int((now + AHEAD_S_MAX) * 1e6) + 1, "a clock that is a day ahead is followed"
    sequencer = Sequencer()
    for seq in (int((now + AHEAD_S_MAX) * 1e6) + 1, 2**62, SEQ_MAX):
        sequencer.saw(seq, now)
        assert sequencer.next(now, above=seq) == min(seq + 1, SEQ_MAX)
    assert sequencer.next(now) < int((now + 1) * 1e6)


def test_a_later_session_begins_above_an_earlier_one() -> None:
    earlier, later = Sequencer(), Sequencer()
    numbers = [earlier.next(1000.0) for _ in range(50)]
    assert later.next(1000.001) > max(numbers)


@given(st.lists(st.integers(0, 6), min_size=1, max_size=60))
def test_no_place_is_given_out_twice(wanted: list[int]) -> None:
    places = FreePlaces()
    taken = [places.take(SPACE, Location.from_number(number)) for number in wanted]
    assert len(set(taken)) == len(taken)
    assert all(place.number >= number for place, number in zip(taken, wanted, strict=True))


def test_spaces_do_not_disturb_each_other_and_the_line_goes_round() -> None:
    places = FreePlaces()
    assert places.take(SPACE, LAST) == LAST
    assert places.take(SpaceId(3), LAST) == LAST
    assert places.take(SPACE, LAST) == FIRST


def test_a_scene_in_one_point_is_refused_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_places, "STEPS_MAX", 3)
    places = FreePlaces()
    for _ in range(3):
        places.take(SPACE, FIRST)
    with pytest.raises(LocalFault, match="same place"):
        places.take(SPACE, FIRST)
