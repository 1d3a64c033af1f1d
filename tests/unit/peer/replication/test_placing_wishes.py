"""If one fails, copies follow every word that somebody says of his arc, or stay with nodes that are gone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import hypothesis.strategies as st
from hypothesis import given

from scenefold.base.ids import NodeId
from scenefold.base.location import LINE_LENGTH, Arc, Location, arcs_between, even_right_bounds
from scenefold.base.placement import Layout, Line
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.replication.placing_wishes import (
    STEADY_S,
    Piece,
    Urgency,
    Wish,
    lasting,
    most_needed,
    needed_of,
    pieces_of,
    ripe,
    shortage_of,
)
from scenefold.wire import Member
from unit.peer.replication.terrace import SCENE, THIRDS

P, A, B, C = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 5))
LAYOUT: Layout = (Location.from_number(7), Location.from_number(8))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def nobody(_member: Member) -> bool:
    return False


@st.composite
def cuts(draw: st.DrawFn) -> list[Piece]:
    """An arc of a hundred places, cut where the holders change."""
    bounds = sorted(draw(st.sets(st.integers(0, 98), max_size=4)))
    firsts, lasts = [0, *(bound + 1 for bound in bounds)], [*bounds, 99]
    sampled = st.sampled_from([(A, B), (A, C), (B, C)])
    return [(arc(first, last), draw(sampled)) for first, last in zip(firsts, lasts, strict=True)]


def at(wishes: Sequence[Wish], number: int) -> Wish:
    (found,) = [wish for wish in wishes if Location.from_number(number) in wish.arc]
    return found


@given(st.lists(cuts(), min_size=1, max_size=5))
def test_each_place_has_wished_its_holders_since_they_were_last_others(looks: list[list[Piece]]) -> None:
    wishes: list[Wish] = []
    for now, pieces in enumerate(looks):
        wishes = lasting(wishes, pieces, 2, now)
    assert all(left.arc.last.next() == right.arc.first for left, right in pairwise(wishes))
    for number in range(100):
        told = [next(holders for piece, holders in look if Location.from_number(number) in piece) for look in looks]
        since = max((now for now in range(1, len(told)) if told[now] != told[now - 1]), default=0)
        assert (at(wishes, number).holders, at(wishes, number).since) == (told[-1], since)


@given(cuts(), cuts())
def test_what_lasts_is_placed_and_nothing_else(first: list[Piece], second: list[Piece]) -> None:
    wishes = lasting((), first, 2, 0.0)
    found = Configurations(P)
    assert ripe(found, LAYOUT, wishes, 0.0, nobody) != [], "the first placement waits for nothing"
    found = found.place(LAYOUT, ripe(found, LAYOUT, wishes, 0.0, nobody), 2)
    assert ripe(found, LAYOUT, wishes, 0.0, nobody) == []
    wishes = lasting(wishes, second, 2, 1.0)
    assert ripe(found, LAYOUT, wishes, STEADY_S, nobody) == [], "it has been so for less than ten seconds"
    found = found.place(LAYOUT, ripe(found, LAYOUT, wishes, 1.0 + STEADY_S, nobody), 2)
    for number in range(100):
        segment = found.at(LAYOUT, Location.from_number(number))
        assert segment is not None
        assert segment.change is not None
        assert segment.change.holders == at(wishes, number).holders
    assert ripe(found, LAYOUT, wishes, 1.0 + STEADY_S, nobody) == []


def test_who_was_removed_is_left_at_once() -> None:
    found = Configurations(P).place(LAYOUT, [(arc(0, 49), (A, B)), (arc(50, 99), (B, C))], 2)
    wishes = lasting((), [(arc(0, 99), (B, C))], 2, 5.0)
    assert ripe(found, LAYOUT, wishes, 5.0, nobody) == []
    assert ripe(found, LAYOUT, wishes, 5.0, lambda member: member == A) == [(arc(0, 49), (B, C))]


def test_who_is_forbidden_is_left_at_once_unless_another_one_who_is_takes_its_place() -> None:
    """Until then writes count on its disk. Where too few are allowed it stays, and nothing is in a hurry."""
    found = Configurations(P).place(LAYOUT, [(arc(0, 49), (A, B)), (arc(50, 99), (B, C))], 2)
    wishes = lasting((), [(arc(0, 99), (B, C))], 2, 5.0)
    assert ripe(found, LAYOUT, wishes, 5.0, nobody, is_forbidden=lambda member: member == A) == [(arc(0, 49), (B, C))]
    assert ripe(found, LAYOUT, wishes, 5.0, nobody, is_forbidden=lambda member: member in (A, B)) == []


def test_while_a_gap_is_open_only_what_is_urgent_is_placed() -> None:
    def there(wanted: int, *absent: Member) -> Urgency:
        return Urgency(wanted, lambda member: member not in absent)

    def a_gone(member: Member) -> bool:
        return member == A

    wishes = lasting((), [(arc(0, 99), (B, C))], 2, 5.0)
    assert ripe(Configurations(P), LAYOUT, wishes, 5.0, nobody, there(2)) == [(arc(0, 99), (B, C))], "the first placement"
    found = Configurations(P).place(LAYOUT, [(arc(0, 49), (A, B)), (arc(50, 99), (B, C))], 2)
    late = 5.0 + STEADY_S
    assert ripe(found, LAYOUT, wishes, late, nobody, there(2)) == [], "it has lasted, and changes again with the gap's next owner"
    assert ripe(found, LAYOUT, wishes, late, a_gone, there(2)) == [], "two are left"
    assert ripe(found, LAYOUT, wishes, late, a_gone, there(3)) == [(arc(0, 49), (B, C))], "one space needs three"
    assert ripe(found, LAYOUT, wishes, late, a_gone, there(2, B)) == [(arc(0, 49), (C,))], "who is left is silent, or full"
    found = Configurations(P).place(LAYOUT, [(arc(0, 49), (A,)), (arc(50, 99), (C, A))], 2)
    assert ripe(found, LAYOUT, wishes, 5.0, a_gone, there(2)) == [(arc(0, 49), (B,))], "as many as are needed"
    found = Configurations(P).place(LAYOUT, [(arc(0, 99), (A, C))], 3)
    wishes = lasting((), [(arc(0, 99), (C,))], 2, 5.0)
    assert ripe(found, LAYOUT, wishes, 5.0, a_gone, there(2)) == [(arc(0, 99), (C,))], "what there is counts only without the removed one"


def test_another_number_that_is_needed_is_another_wish() -> None:
    found = Configurations(P).place(LAYOUT, [(arc(0, 99), (A, B))], 1)
    wishes = lasting(lasting((), [(arc(0, 99), (A, B))], 1, 0.0), [(arc(0, 99), (A, B))], 2, 1.0)
    assert ripe(found, LAYOUT, wishes, STEADY_S, nobody) == []
    assert ripe(found, LAYOUT, wishes, 1.0 + STEADY_S, nobody) == [(arc(0, 99), (A, B))]


def test_layouts_are_those_of_all_scenes_and_the_lowest_number_counts() -> None:
    assert needed_of([SCENE], 5) == {THIRDS: 2}
    assert needed_of([SCENE], 1) == {THIRDS: 1}
    strict = replace(SCENE, needed=dict.fromkeys(SCENE.needed, 3))
    assert needed_of([strict], 5) == {THIRDS: 3}
    assert needed_of([strict, SCENE], 5) == {THIRDS: 2}
    assert most_needed([strict, SCENE], 5) == {THIRDS: 3}
    assert most_needed([strict, SCENE], 2) == {THIRDS: 2}


def test_who_may_not_be_taken_is_not() -> None:
    nodes = [NodeId(number) for number in range(1, 5)]
    tiles = arcs_between(even_right_bounds(4))
    line = Line(zip(nodes, tiles, strict=True))
    allowed = {member.node: member for member in (A, C)}
    half = (Location.from_number(LINE_LENGTH // 2),)
    assert pieces_of(line, P.node, half, [tiles[0]], {**allowed, B.node: B}, nodes) == [(tiles[0], (B,))]
    assert {holders for _, holders in pieces_of(line, P.node, half, [tiles[0]], allowed, nodes)} == {(A,), (C,)}
    assert pieces_of(line, P.node, half, [tiles[0]], {}, nodes) == [(tiles[0], ())]


def test_a_shortage_says_why() -> None:
    nodes = [A.node, B.node, C.node]
    assert shortage_of(LAYOUT, 2, nodes, nodes, P.node) is None
    assert shortage_of(LAYOUT, 2, nodes[:2], nodes, P.node) is None
    short = shortage_of(LAYOUT, 2, nodes[:1], nodes, P.node)
    assert short is not None
    assert (short.possible, short.whose, short.forbids_writes) == (2, P.node, False)
    assert "blacklist of" in str(short)
    short = shortage_of(LAYOUT, 2, [], [], P.node)
    assert short is not None
    assert (short.possible, short.whose, short.forbids_writes) == (1, None, True)


def test_who_has_no_arc_is_placed_as_far_as_writes_need_it() -> None:
    nodes = [P.node, A.node, B.node, C.node]
    tiles = arcs_between(even_right_bounds(2))
    line = Line([(P.node, tiles[0]), (A.node, tiles[1]), (B.node, None), (C.node, None)])
    allowed = {member.node: member for member in (A, B, C)}
    assert pieces_of(line, P.node, LAYOUT, [tiles[0]], allowed, nodes, 2) == [(tiles[0], (A,))]
    assert pieces_of(line, P.node, LAYOUT, [tiles[0]], allowed, nodes, 3) == [(tiles[0], (A, B))]
    for most, possible in ((1, 2), (2, 2)):
        short = shortage_of(LAYOUT, most, allowed.keys(), allowed.keys(), P.node, 2, most)
        assert short is not None
        assert (short.possible, short.whose, short.forbids_writes) == (possible, None, False)
    assert shortage_of(LAYOUT, 3, allowed.keys(), allowed.keys(), P.node, 2, 3) is None
