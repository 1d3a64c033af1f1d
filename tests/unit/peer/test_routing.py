"""If this fails, a location has no owner or two, and records are lost or written twice."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Arc, Location
from scenefold.peer import Routing

members = st.sets(st.integers(1, 2**32 - 1).map(NodeId), min_size=1, max_size=127)
locations = st.integers(0, LINE_LENGTH - 1).map(Location.from_number)


@given(members)
def test_arcs_tile_the_line_in_id_order(nodes: set[NodeId]) -> None:
    routing = Routing(nodes)
    arcs = [routing.arc_of(node) for node in sorted(nodes)]
    assert arcs[0].first == FIRST and arcs[-1].last == LAST
    assert all(left.last.next() == right.first for left, right in pairwise(arcs))


@given(members)
def test_arcs_are_even(nodes: set[NodeId]) -> None:
    routing = Routing(nodes)
    lengths = [routing.arc_of(node).length for node in nodes]
    assert max(lengths) - min(lengths) <= 1


@given(members, locations)
def test_the_owner_is_who_has_the_arc(nodes: set[NodeId], location: Location) -> None:
    routing = Routing(nodes)
    assert [node for node in nodes if location in routing.arc_of(node)] == [routing.owner_of(location)]


@given(members)
def test_bounds_belong_to_their_arc(nodes: set[NodeId]) -> None:
    routing = Routing(nodes)
    for node in nodes:
        arc = routing.arc_of(node)
        assert routing.owner_of(arc.first) == routing.owner_of(arc.last) == node


@given(members, locations, locations)
def test_a_range_is_shared_out_without_gaps(nodes: set[NodeId], one: Location, other: Location) -> None:
    arc = Arc(min(one, other), max(one, other))
    pieces = list(Routing(nodes).owners_of(arc))
    assert pieces[0][1].first == arc.first and pieces[-1][1].last == arc.last
    assert sum(piece.length for _, piece in pieces) == arc.length
