"""If this fails, two nodes look for the copies of one record at different places, or a log of a former version cannot be read."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import SpaceId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.location import FIRST, LINE_LENGTH, Location
from scenefold.scene.log import Layouts, free_offsets
from scenefold.wire import SpaceEntry

HALL = SpaceId(11)
OFFSETS = st.integers(0, LINE_LENGTH - 1).map(Location.from_number)


def at(number: int) -> Location:
    return Location.from_number(number)


def hall(copies: int = 3, copies_min: int = 2) -> SpaceEntry:
    return SpaceEntry(HALL, SpaceId(0), FIRST, copies, copies_min, render_output=False, node_managed=False)


def shade(number: int, offset: int, parent: int = HALL) -> SpaceEntry:
    return SpaceEntry(SpaceId(number), SpaceId(parent), at(offset), 1, 1, render_output=False, node_managed=False)


def test_the_layout_is_the_offsets_in_the_order_of_the_numbers() -> None:
    found = Layouts.of([hall(), shade(14, 5), shade(12, 9)])
    assert found.offsets == {HALL: (at(9), at(5))}
    assert (found.needed, found.wanted, found.parents) == ({HALL: 2}, {HALL: 3}, {14: HALL, 12: HALL})
    assert found.shadows == {HALL: (12, 14)} and found.lacking() == {}


@pytest.mark.parametrize(
    ("entries", "offsets", "needed"),
    [
        ([hall(2), shade(12, 9), shade(13, 5)], (9,), 2),
        ([hall(1, 1), shade(12, 9)], (), 1),
        ([hall(), shade(12, 0), shade(13, 9), shade(14, 9), shade(15, 5)], (9, 5), 2),
        ([hall(3, 3), shade(12, 9)], (9,), 2),
        ([hall(3, 2)], (), 1),
        ([hall(0, 0), shade(12, 9)], (), 1),
        ([hall(255, 200), *(shade(12 + index, 1 + index) for index in range(12))], (1, 2, 3, 4, 5, 6, 7), COPIES_MAX),
        ([hall(), shade(12, 9), shade(13, 5, parent=12), shade(14, 5, parent=99)], (9,), 2),
        ([hall(2), hall(8), shade(12, 9), shade(13, 5)], (9,), 2),
    ],
    ids=[
        "lowered",
        "noted for one copy",
        "no distance, or the same twice",
        "more needed than there are",
        "copies without shadows",
        "no copies at all",
        "more than there may be",
        "shadows of shadows and of nothing",
        "one number twice",
    ],
)
def test_what_does_not_count(entries: list[SpaceEntry], offsets: tuple[int, ...], needed: int) -> None:
    found = Layouts.of(entries)
    assert found.offsets[HALL] == tuple(map(at, offsets))
    assert found.needed[HALL] == needed
    assert set(found.offsets) == set(found.needed) == {HALL}, "shadows have no copies of their own"


def test_it_is_said_which_spaces_lack_shadows() -> None:
    other = SpaceEntry(SpaceId(20), SpaceId(0), FIRST, 2, 1, render_output=False, node_managed=False)
    assert Layouts.of([hall(3), shade(12, 9), other]).lacking() == {HALL: 2, 20: 1}


@given(st.integers(1, COPIES_MAX))
def test_offsets_of_a_new_space_cut_the_line_evenly(copies: int) -> None:
    assert free_offsets((), copies - 1) == [at(index * LINE_LENGTH // copies) for index in range(1, copies)]


def test_further_offsets_lie_where_there_is_most_room() -> None:
    half, third = LINE_LENGTH // 2, LINE_LENGTH // 3
    assert free_offsets([at(half)], 1) == [at(half // 2)]
    assert free_offsets([at(half)], 2) == [at(half // 2), at(half + half // 2)]
    assert free_offsets([at(third), at(2 * third)], 1) == [at(2 * third + (LINE_LENGTH - 2 * third) // 2)]
    assert free_offsets([at(1)], 2) == [at(1 + (LINE_LENGTH - 1) // 3), at(1 + 2 * (LINE_LENGTH - 1) // 3)]


def gap(offsets: list[Location]) -> int:
    """The smallest distance of any two, 0 among them, around the line."""
    numbers = sorted([0, *(offset.number for offset in offsets), LINE_LENGTH])
    return min(second - first for first, second in pairwise(numbers))


@given(st.sets(OFFSETS.filter(lambda offset: offset != FIRST), max_size=COPIES_MAX), st.integers(0, COPIES_MAX), st.randoms())
def test_free_offsets_are_new_and_the_same_for_all(taken: set[Location], count: int, dice: object) -> None:
    ordered, shuffled = sorted(taken), list(taken)
    dice.shuffle(shuffled)  # type: ignore[attr-defined]
    found = free_offsets(ordered, count)
    assert found == free_offsets(shuffled, count)
    assert len({FIRST, *taken, *found}) == 1 + len(taken) + count
    # No choice is farther from everything than this, for whatever is taken leaves one piece of at least that size.
    if count == 1:
        pieces = sorted([0, *(offset.number for offset in taken), LINE_LENGTH])
        widest = max(second - first for first, second in pairwise(pieces))
        assert min(abs(found[0].number - number) for number in pieces) == widest // 2
        assert gap([*ordered, *found]) <= widest // 2 + 1


@given(st.lists(st.tuples(st.integers(1, 20), st.integers(0, 20), st.integers(0, 6), st.integers(0, 9), st.integers(0, 9))), st.randoms())
def test_whatever_a_header_says_its_layouts_are_lawful(rows: list[tuple[int, int, int, int, int]], dice: object) -> None:
    """Whoever has an owner's keys can sign any header."""
    entries = [
        SpaceEntry(SpaceId(space), SpaceId(parent), at(offset), copies, least, render_output=False, node_managed=False)
        for space, parent, offset, copies, least in {row[0]: row for row in rows}.values()
    ]
    found = Layouts.of(entries)
    dice.shuffle(entries)  # type: ignore[attr-defined]
    assert Layouts.of(entries) == found
    assert set(found.offsets) | set(found.parents) == {entry.space for entry in entries}
    for space, offsets in found.offsets.items():
        assert len({FIRST, *offsets}) == 1 + len(offsets) <= COPIES_MAX
        assert 1 <= found.needed[space] <= 1 + len(offsets) <= found.wanted[space]
