"""If this fails, one of two nodes that claim a place is never asked for it, or somebody is asked who claims it not."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.cover import Cover, runs, without
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Arc, Location

edges = st.sampled_from([0, 1, 2, 3, 50, 51, 52, LINE_LENGTH - 2, LINE_LENGTH - 1]) | st.integers(0, LINE_LENGTH - 1)
locations = edges.map(Location.from_number)
arcs = st.tuples(locations, locations).map(lambda ends: Arc(min(ends), max(ends)))
claims = st.lists(arcs, max_size=8)


@given(claims, locations)
def test_all_who_claim_a_place_are_asked_for_it_in_the_order_of_preference(claimed: list[Arc], where: Location) -> None:
    cover = Cover([(arc, number) for number, arc in enumerate(claimed)])
    holders = [number for number, arc in enumerate(claimed) if where in arc]
    if holders:
        assert list(cover.at(where)) == holders
        return
    right = [arc.first for arc in claimed if arc.first > where]
    left = [arc.last for arc in claimed if arc.last < where]
    asked = [claimed[number] for number in cover.at(where)]
    assert [arc.first for arc in asked if arc.first > where] == ([min(right)] if right else [])
    assert [arc.last for arc in asked if arc.last < where] == ([max(left)] if left else [])
    assert not (right and left) or asked[0].first > where


@given(claims)
def test_stretches_are_the_whole_line(claimed: list[Arc]) -> None:
    cover = Cover([(arc, number) for number, arc in enumerate(claimed)])
    found = list(cover.stretches())
    assert found[0][0].first == FIRST and found[-1][0].last == LAST
    assert all(left.last.next() == right.first for (left, _), (right, _) in pairwise(found))
    assert all(cover.at(arc.first) == cover.at(arc.last) == held for arc, held in found)


def test_runs_join_what_is_one_owners() -> None:
    place = Location.from_number
    one, two, three = Arc(FIRST, place(4)), Arc(place(5), place(9)), Arc(place(10), LAST)
    assert runs([(one, "a"), (two, "a"), (three, "b")]) == [(Arc(FIRST, place(9)), "a"), (three, "b")]
    assert runs([(one, "a"), (three, "a")]) == [(one, "a"), (three, "a")]


@given(arcs, st.none() | arcs, locations)
def test_without_leaves_exactly_the_rest(arc: Arc, taken: Arc | None, where: Location) -> None:
    rest = without(arc, taken)
    assert any(where in piece for piece in rest) == (where in arc and (taken is None or where not in taken))
    assert len(rest) <= 2 and sum(piece.length for piece in rest) <= arc.length
