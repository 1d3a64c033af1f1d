"""If this fails, a location has no node to ask or two, or requests go round in circles between nodes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer import Routing
from scenefold.peer.registry import Registry
from unit.peer.logs_made import add, folded, found, node, remove

locations = st.integers(0, LINE_LENGTH - 1).map(Location.from_number)
claims = st.dictionaries(st.integers(0, 5).map(node), st.none() | locations)
FIRST_NODE = node(0)
REGISTRY = folded(found(5), add(0), add(1), add(2))


@dataclass
class Claimed:
    bounds: dict[NodeId, Location | None] = field(default_factory=dict)
    bounds_version: int = 0

    def right_bounds(self) -> Mapping[NodeId, Location | None]:
        return self.bounds

    def say(self, number: int, bound: Location | None) -> None:
        self.bounds[node(number)] = bound
        self.bounds_version += 1


@dataclass
class Me:
    me: NodeId = FIRST_NODE
    arc: Arc | None = None


def place(share: float) -> Location:
    return Location.from_number(int(LINE_LENGTH * share))


def a_view(registry: Registry = REGISTRY, claimed: Claimed | None = None, own: Me | None = None) -> Routing:
    known = own or Me(arc=registry.founding_arc(node(0)) if registry.position else None)
    return Routing(lambda: registry, claimed or Claimed(), known)


def test_before_anybody_is_heard_founders_have_their_founding_arcs() -> None:
    view = a_view()
    assert view.members == REGISTRY.order
    assert [view.arc_of(member) for member in REGISTRY.order] == [REGISTRY.founding_arc(member) for member in REGISTRY.order]


def test_as_long_as_the_log_is_unknown_there_is_nobody_to_ask() -> None:
    with pytest.raises(Refused) as caught:
        a_view(Registry()).owner_of(FIRST)
    assert caught.value.reason == RejectReason.NOT_READY
    assert list(a_view(Registry()).owners_of(Arc(FIRST, LAST))) == []


def test_what_a_node_says_of_its_bound_counts_at_once() -> None:
    claimed = Claimed()
    view = a_view(claimed=claimed)
    assert view.owner_of(place(0.5)) == node(2)
    claimed.say(1, place(0.55))
    assert view.owner_of(place(0.5)) == node(1) and view.owner_of(place(0.57)) == node(2)
    claimed.say(2, None)
    assert view.arc_of(node(2)) is None and view.owner_of(place(0.57)) == node(3)


def test_who_comes_and_owns_nothing_is_asked_for_nothing() -> None:
    view = a_view(folded(found(3), add(0), add(4, left_of=1)))
    assert node(4) in view.members and view.arc_of(node(4)) is None


def test_the_gap_of_a_removed_node_is_its_right_neighbours_and_at_the_end_the_last_ones() -> None:
    registry = folded(found(3), add(0), add(1), add(2), remove(1))
    assert a_view(registry).owner_of(place(0.5)) == node(2)
    assert a_view(folded(found(3), add(0), add(1), add(2), remove(2))).owner_of(LAST) == node(1)


def test_of_its_own_arc_a_node_believes_nobody_else() -> None:
    own = Me(node(2), Arc(place(0.3), place(0.6)))
    claimed = Claimed({node(1): place(0.5), node(3): place(0.5)})
    view = a_view(claimed=claimed, own=own)
    assert view.arc_of(node(2)) == own.arc and view.owner_of(place(0.4)) == node(2)
    own.arc = None
    assert view.arc_of(node(2)) is None


@given(claims, st.integers(0, 4), st.none() | st.tuples(locations, locations), locations)
def test_whatever_nodes_claim_the_line_is_tiled_and_everybody_asked_has_an_arc(
    said: dict[NodeId, Location | None], number: int, ends: tuple[Location, Location] | None, where: Location
) -> None:
    own = Me(node(number), None if ends is None else Arc(min(ends), max(ends)))
    view = a_view(claimed=Claimed(said), own=own)
    owners = view.owners
    if not owners:
        assert own.arc is None
        return
    arcs = [arc for _, arc in owners]
    assert arcs[0].first == FIRST and arcs[-1].last == LAST
    assert all(left.last.next() == right.first for left, right in pairwise(arcs))
    assert [member for member, _ in owners] == [member for member in view.members if view.arc_of(member) is not None]
    assert [member for member, arc in owners if where in arc] == [view.owner_of(where)]
    if own.arc is not None:
        assert view.owner_of(own.arc.first) == view.owner_of(own.arc.last) == own.me
    whole = list(view.owners_of(Arc(min(where, LAST), LAST)))
    assert whole[0][1].first == where and whole[-1][1].last == LAST
    assert sum(piece.length for _, piece in whole) == LINE_LENGTH - where.number
