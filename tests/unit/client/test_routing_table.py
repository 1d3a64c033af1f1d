"""If this fails, clients ask the wrong nodes, or miss parts of the line."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Location, even_right_bounds
from scenefold.client.split import frames
from scenefold.client.table import Owner, RoutingTable

LOCATIONS = st.binary(min_size=20, max_size=20).map(Location)


def _table(bounds: list[Location]) -> RoutingTable:
    return RoutingTable(Owner(NodeId(10 + index), f"127.0.0.{10 + index}", bound) for index, bound in enumerate(bounds))


@given(st.lists(LOCATIONS, min_size=1, max_size=12), LOCATIONS)
def test_arcs_tile_the_line_and_hold_what_their_owner_owns(bounds: list[Location], location: Location) -> None:
    table = _table(bounds)
    arcs = table.arcs()
    assert arcs[0][1].first == FIRST and arcs[-1][1].last == LAST
    assert sum(arc.length for _, arc in arcs) == WHOLE_LINE.length
    holders = [owner for owner, arc in arcs if location in arc]
    assert holders == [table.owner_of(location)]


def test_a_bound_is_the_last_location_of_its_owner() -> None:
    table = _table(even_right_bounds(3))
    bound = table.owners[0].right_bound
    following = bound.next()
    assert following is not None
    assert table.owner_of(bound) is table.owners[0]
    assert table.owner_of(following) is table.owners[1]


def test_nodes_that_own_nothing_are_known_and_asked_for_no_place() -> None:
    empty = Owner(NodeId(5), "e", None)
    table = RoutingTable([empty, *_table(even_right_bounds(2)).owners])
    assert table.by_id(NodeId(5)) is empty and table.owners[-1] is empty
    assert [owner.node_id for owner, _ in table.arcs()] == [10, 11]
    assert table.owner_of(LAST).node_id == 11
    joined = table.updated(Owner(NodeId(5), "e", Location.from_number(9), 1))
    assert joined.owner_of(FIRST).node_id == 5
    nobody = RoutingTable([empty])
    assert (nobody.arcs(), nobody.owner_of(FIRST), nobody.end_of(FIRST)) == ([], empty, LAST)


def test_who_owns_nothing_is_asked_for_copies_where_too_few_have_an_arc() -> None:
    owners = [*_table(even_right_bounds(2)).owners, Owner(NodeId(5), "e", None), Owner(NodeId(4), "f", None)]
    table, layout = RoutingTable(owners), (Location.from_number(1), Location.from_number(2))
    assert [table.holders_of(layout, FIRST, needed) for needed in (1, 2, 3)] == [(11,), (11,), (11, 4)]


@given(st.lists(LOCATIONS, min_size=1, max_size=12), LOCATIONS)
def test_an_owner_is_asked_for_all_up_to_the_end_of_its_stretch(bounds: list[Location], location: Location) -> None:
    table = _table(bounds)
    end = table.end_of(location)
    assert next(arc.last for holder, arc in table.arcs() if location in arc and holder is table.owner_of(location)) == end


def test_of_two_that_claim_a_place_both_are_candidates_and_beside_a_gap_as_well() -> None:
    place = Location.from_number
    left, right = Owner(NodeId(1), "l", place(60), first=FIRST), Owner(NodeId(2), "r", LAST, first=place(40))
    table = RoutingTable([left, right])
    assert [table.candidates(place(number)) for number in (39, 40, 60, 61)] == [(left,), (left, right), (left, right), (right,)]
    assert table.end_of(place(10)) == place(60) and table.end_of(place(61)) == LAST
    apart = RoutingTable([left, Owner(NodeId(2), "r", LAST, first=place(80))])
    assert [owner.node_id for owner in apart.candidates(place(70))] == [2, 1]
    moved = table.updated(Owner(NodeId(2), "r", place(30), 1, first=place(40)))
    assert moved.candidates(place(35)) == (left,), "a beginning behind the end is none"


def test_only_newer_news_change_the_table() -> None:
    table = RoutingTable([Owner(NodeId(1), "a", Location.from_number(5), 7), Owner(NodeId(2), "b", LAST, 7)])
    assert table.updated(Owner(NodeId(1), "a", Location.from_number(9), 7)) is table
    changed = table.updated(Owner(NodeId(1), "a", Location.from_number(9), 8))
    assert changed.owner_of(Location.from_number(8)).node_id == 1
    assert table.owner_of(Location.from_number(8)).node_id == 2
    joined = changed.updated(Owner(NodeId(3), "c", FIRST, 1))
    assert joined.owner_of(FIRST).node_id == 3
    confirmed = table.updated(Owner(NodeId(1), "a", Location.from_number(5), 9))
    assert confirmed.updated(Owner(NodeId(1), "a", Location.from_number(9), 8)) is confirmed, "what was confirmed at 9 is not from before"
    assert confirmed.updated(Owner(NodeId(1), "a", Location.from_number(9), 10)).owner_of(Location.from_number(8)).node_id == 1
    assert (table.by_id(NodeId(1)).lamport, confirmed.by_id(NodeId(1)).lamport) == (7, 9)  # type: ignore[union-attr]
    later = confirmed.updated(Owner(NodeId(2), "b", Location.from_number(99), 8))
    assert later.by_id(NodeId(1)).lamport == 9, "also when the table is made anew"  # type: ignore[union-attr]


@given(st.lists(st.integers(0, 50), max_size=60), st.integers(1, 120), st.integers(1, 7))
def test_frames_keep_their_bounds_and_all_records(sizes: list[int], bytes_max: int, count_max: int) -> None:
    cut = list(frames(range(len(sizes)), sizes, bytes_max, count_max))
    assert [index for frame in cut for index in frame] == list(range(len(sizes)))
    for frame in cut:
        assert 1 <= len(frame) <= count_max
        assert len(frame) == 1 or sum(sizes[index] for index in frame) <= bytes_max
