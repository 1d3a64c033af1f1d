"""If one fails, copies are looked for or put where Algorithm 7 does not put them."""

from __future__ import annotations

from itertools import pairwise
from time import process_time

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, WHOLE_LINE, Arc, Location, arcs_between, even_right_bounds
from scenefold.base.placement import Layout, Line, holders_at, segments

Claims = list[tuple[NodeId, Arc | None]]
THIRDS: Layout = (Location.from_number(LINE_LENGTH // 3), Location.from_number(2 * LINE_LENGTH // 3))


def place(number: int) -> Location:
    return Location.from_number(number % LINE_LENGTH)


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def distance(found: Arc, number: int) -> int:
    if found.first.number <= number <= found.last.number:
        return 0
    return min((found.first.number - number) % LINE_LENGTH, (number - found.last.number) % LINE_LENGTH)


def by_the_book(
    claims: Claims, owner: NodeId, forbidden: set[NodeId], layout: Layout, location: Location, least: int
) -> tuple[NodeId, ...]:
    """Algorithm 7, word by word; and who has no arc, where that does not give enough."""
    holders: list[NodeId] = []
    for offset in layout:
        copy = (location.number + offset.number) % LINE_LENGTH
        rest = [
            (distance(found, copy), node)
            for node, found in claims
            if found is not None and node != owner and node not in forbidden and node not in holders
        ]
        holders += [min(rest)[1]] if rest else []
    for node in sorted(node for node, found in claims if found is None and node != owner and node not in forbidden):
        if len(holders) < min(least, len(layout)):
            holders.append(node)
    return tuple(holders)


# Few numbers, many of them beside each other or at the ends, so that ties, seams and overlaps are met.
numbers = st.one_of(
    st.integers(0, 40),
    st.integers(LINE_LENGTH - 40, LINE_LENGTH - 1),
    st.integers(0, 63).map(lambda part: part * (LINE_LENGTH // 64)),
    st.integers(0, LINE_LENGTH - 1),
)
arcs = st.tuples(numbers, numbers).map(lambda ends: arc(min(ends), max(ends)))


@st.composite
def lines(draw: st.DrawFn) -> Claims:
    """Arcs that tile the line, some of them missing, some longer than they are."""
    bounds = sorted(draw(st.sets(numbers, max_size=9)) - {LINE_LENGTH - 1})
    nodes = draw(st.permutations([NodeId(number) for number in range(1, len(bounds) + 2)]))
    found: Claims = []
    for node, tile in zip(nodes, arcs_between([*map(Location.from_number, bounds), LAST]), strict=True):
        kind = draw(st.sampled_from(["as it is"] * 6 + ["none", "long"]))
        longer = arc(max(0, tile.first.number - draw(st.integers(0, 30))), min(LAST.number, tile.last.number + draw(st.integers(0, 30))))
        found.append((node, None if kind == "none" else longer if kind == "long" else tile))
    return found


layouts = st.lists(numbers.filter(bool), max_size=4, unique=True).map(lambda found: tuple(map(Location.from_number, found)))


@settings(max_examples=300, deadline=None)
@given(
    claims=lines(),
    layout=layouts,
    piece=arcs,
    forbidden=st.sets(st.integers(1, 12).map(NodeId), max_size=4),
    owner=st.integers(1, 11),
    least=st.integers(0, 4),
    data=st.data(),
)
def test_segments_are_those_of_the_algorithm(
    claims: Claims, layout: Layout, piece: Arc, forbidden: set[NodeId], owner: int, least: int, data: st.DataObject
) -> None:
    me, line = NodeId(owner), Line(claims)
    found = segments(line, me, forbidden, layout, piece, least)
    assert found[0][0].first == piece.first
    assert found[-1][0].last == piece.last
    for (left, before), (right, after) in pairwise(found):
        assert left.last.next() == right.first
        assert before != after
    asked = {end for cut, _ in found for end in (cut.first.number, cut.last.number)}
    asked |= {data.draw(st.integers(cut.first.number, cut.last.number)) for cut, _ in found}
    asked |= {number for number in data.draw(st.lists(numbers, max_size=3)) if place(number) in piece}
    for number in asked:
        expected = by_the_book(claims, me, forbidden, layout, place(number), least)
        assert holders_at(line, me, forbidden, layout, place(number), least) == expected
        assert [holders for cut, holders in found if place(number) in cut] == [expected]


def test_one_node_has_nobody_to_hold_copies() -> None:
    assert segments(Line([(NodeId(1), WHOLE_LINE)]), NodeId(1), (), THIRDS, WHOLE_LINE) == [(WHOLE_LINE, ())]


def test_a_line_that_nobody_claims_has_no_holders() -> None:
    assert segments(Line([]), NodeId(1), (), THIRDS, arc(5, 9)) == [(arc(5, 9), ())]


def test_a_blacklist_that_forbids_everybody_leaves_none() -> None:
    claims = [(NodeId(node), found) for node, found in zip((1, 2, 3), arcs_between(even_right_bounds(3)), strict=True)]
    assert segments(Line(claims), NodeId(1), {NodeId(2), NodeId(3)}, THIRDS, claims[0][1]) == [(claims[0][1], ())]


def test_the_next_closest_is_taken_for_a_forbidden_or_taken_one() -> None:
    """The thesis may take node 2 twice, as it is the nearest for both shadows."""
    claims = [(NodeId(1), arc(0, 99)), (NodeId(2), arc(100, 999)), (NodeId(3), arc(1000, 1099)), (NodeId(4), arc(1100, LAST.number))]
    layout = Location.from_number(150), Location.from_number(250)
    assert holders_at(Line(claims), NodeId(1), (), layout, FIRST) == (NodeId(2), NodeId(4))
    assert holders_at(Line(claims), NodeId(1), {NodeId(4)}, layout, FIRST) == (NodeId(2), NodeId(3))


def test_who_has_no_arc_is_taken_only_where_a_write_could_not_count_otherwise() -> None:
    """Else, after losses, nothing would settle, and so nobody would ever be given an arc."""
    claims: Claims = [(NodeId(1), arc(0, 99)), (NodeId(5), arc(100, LAST.number)), *((NodeId(node), None) for node in (4, 2, 3))]
    line = Line(claims)
    assert [holders_at(line, NodeId(1), (), THIRDS, FIRST, least) for least in (0, 1)] == [(NodeId(5),)] * 2
    assert holders_at(line, NodeId(1), (), THIRDS, FIRST, 2) == (NodeId(5), NodeId(2))
    assert holders_at(line, NodeId(1), {NodeId(2), NodeId(5)}, THIRDS, FIRST, 2) == (NodeId(3), NodeId(4))
    assert segments(line, NodeId(1), {NodeId(3)}, THIRDS, claims[0][1] or WHOLE_LINE, 7) == [(arc(0, 99), (NodeId(5), NodeId(2)))]


def test_who_claims_two_pieces_has_an_arc() -> None:
    assert Line([(NodeId(1), None), (NodeId(2), None), (NodeId(2), arc(0, 9)), (NodeId(2), arc(20, 29))]).waiting == (NodeId(1),)


def test_of_two_as_near_the_lower_id_is_taken() -> None:
    claims: Claims = [(NodeId(9), arc(0, 10)), (NodeId(1), arc(11, 19)), (NodeId(5), arc(20, LAST.number))]
    found = segments(Line(claims), NodeId(1), (), (Location.from_number(LINE_LENGTH - 1),), arc(11, 19))
    assert found == [(arc(11, 15), (NodeId(9),)), (arc(16, 19), (NodeId(5),))]
    swapped = [(NodeId(10 - node), held) for node, held in claims]
    found = segments(Line(swapped), NodeId(9), (), (Location.from_number(LINE_LENGTH - 1),), arc(11, 19))
    assert found == [(arc(11, 16), (NodeId(1),)), (arc(17, 19), (NodeId(5),))]


@pytest.mark.parametrize("nodes", [250, 1_000])
def test_it_costs_what_its_segments_cost(nodes: int) -> None:
    """A view of a thousand nodes, and the pieces of one: all of the line beside tiny arcs, or a thousandth of it."""
    bounds = even_right_bounds(nodes)
    line = Line([(NodeId(1 + node), found) for node, found in enumerate(arcs_between(bounds))])
    begun = process_time()
    found = segments(line, NodeId(1), (), THIRDS, arc(0, bounds[0].number))
    assert len(found) <= 6
    of_a_part = process_time() - begun
    begun = process_time()
    all_of_it = segments(line, NodeId(nodes + 1), (), THIRDS, WHOLE_LINE)
    whole = process_time() - begun
    assert len(all_of_it) <= 2 * nodes + 4
    assert of_a_part < 0.05
    assert whole < 0.002 * nodes
