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
from scenefold.peer.cluster_log.registry import Registry
from unit.peer.logs_made import add, folded, found, node, remove

locations = st.integers(0, LINE_LENGTH - 1).map(Location.from_number)
arcs = st.tuples(locations, locations).map(lambda ends: Arc(min(ends), max(ends)))
claims = st.dictionaries(st.integers(0, 5).map(node), st.none() | arcs)
FIRST_NODE = node(0)
REGISTRY = folded(found(5), add(0), add(1), add(2))


@dataclass
class Claimed:
    said: dict[NodeId, Arc | None] = field(default_factory=dict)
    arcs_version: int = 0
    dead: set[NodeId] = field(default_factory=set)
    last: list[NodeId] = field(default_factory=list)
    """Who spoke, the newest word last."""

    def arcs(self) -> Mapping[NodeId, Arc | None]:
        return self.said

    def said_at(self, member: NodeId) -> float:
        return len(self.last) - self.last[::-1].index(member) if member in self.last else -1.0

    def is_believed_alive(self, member: NodeId) -> bool:
        return member not in self.dead

    def say(self, number: int, first: float | None = None, last: float = 1.0) -> None:
        """A node says from where to where, in shares of the line, its arc goes."""
        self.said[node(number)] = None if first is None else Arc(place(first), place(last))
        self.last.append(node(number))
        self.arcs_version += 1


@dataclass
class Me:
    me: NodeId = FIRST_NODE
    arc: Arc | None = None


def place(share: float) -> Location:
    return Location.from_number(min(int(LINE_LENGTH * share), LINE_LENGTH - 1))


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
    assert a_view(Registry()).owners == []


def test_what_a_node_says_of_its_arc_counts_at_once() -> None:
    claimed = Claimed()
    view = a_view(claimed=claimed)
    assert view.owner_of(place(0.5)) == node(2)
    claimed.say(1, 0.2, 0.55)
    claimed.say(2, 0.55, 0.6)
    assert view.owner_of(place(0.5)) == node(1) and view.owner_of(place(0.57)) == node(2)
    claimed.say(2)
    assert view.arc_of(node(2)) is None and view.owner_of(place(0.57)) == node(3)


@pytest.mark.parametrize(("giver", "receiver"), [(2, 3), (3, 2)])
def test_when_a_giver_dies_before_it_says_what_it_gave_both_are_asked_and_the_living_one_first(giver: int, receiver: int) -> None:
    claimed = Claimed()
    view = a_view(claimed=claimed)
    claimed.say(receiver, *((0.5, 0.8) if receiver == 3 else (0.4, 0.7)))
    # The giver may even have been heard after the receiver: its word went round by way of others.
    claimed.say(giver, *((0.4, 0.6) if giver == 2 else (0.6, 0.8)))
    moved = place(0.55 if giver == 2 else 0.65)
    assert view.candidates(moved) == [node(giver), node(receiver)]
    claimed.dead.add(node(giver))
    assert view.candidates(moved) == [node(receiver), node(giver)], "as soon as one request to it has failed"
    claimed.dead.add(node(receiver))
    claimed.say(receiver, *((0.5, 0.8) if receiver == 3 else (0.4, 0.7)))
    assert view.candidates(moved) == [node(receiver), node(giver)], "of two that are alike who has spoken last"


def test_who_comes_and_owns_nothing_is_asked_for_nothing() -> None:
    view = a_view(folded(found(3), add(0), add(4, left_of=1)))
    assert node(4) in view.members and view.arc_of(node(4)) is None


def test_the_gap_of_a_removed_node_is_its_right_neighbours_and_at_the_end_the_last_ones() -> None:
    registry = folded(found(3), add(0), add(1), add(2), remove(1))
    assert a_view(registry).owner_of(place(0.5)) == node(2)
    assert a_view(folded(found(3), add(0), add(1), add(2), remove(2))).owner_of(LAST) == node(1)


def test_a_piece_on_its_way_is_asked_of_both_sides_and_of_a_dead_one_last() -> None:
    claimed = Claimed()
    view = a_view(claimed=claimed)
    claimed.say(2, 0.4, 0.5)
    claimed.say(3, 0.6, 0.8)
    assert view.candidates(place(0.55)) == [node(3), node(2)]
    claimed.dead.add(node(3))
    assert view.candidates(place(0.55)) == [node(2), node(3)]


def test_of_its_own_arc_a_node_believes_nobody_else() -> None:
    own = Me(node(2), Arc(place(0.3), place(0.6)))
    claimed = Claimed({node(1): Arc(FIRST, place(0.5)), node(3): Arc(place(0.2), place(0.5))})
    view = a_view(claimed=claimed, own=own)
    assert view.arc_of(node(2)) == own.arc and view.candidates(place(0.4)) == (node(2),)
    own.arc = None
    assert view.arc_of(node(2)) is None


def test_this_node_is_the_last_whom_it_asks_for_what_it_does_not_have() -> None:
    view = a_view(claimed=Claimed({node(1): None, node(2): Arc(place(0.5), place(0.6))}))
    assert view.candidates(place(0.3)) == [node(2), node(0)]


@given(claims, st.integers(0, 4), st.none() | arcs, locations)
def test_whatever_nodes_claim_the_line_is_tiled_and_all_who_claim_a_place_are_asked(
    said: dict[NodeId, Arc | None], number: int, arc: Arc | None, where: Location
) -> None:
    own = Me(node(number), arc)
    view = a_view(claimed=Claimed(said), own=own)
    owners = view.owners
    if not owners:
        assert own.arc is None
        return
    found = [arc for _, arc in owners]
    assert found[0].first == FIRST and found[-1].last == LAST
    assert all(left.last.next() == right.first for left, right in pairwise(found))
    assert [member for member, arc in owners if where in arc] == [view.owner_of(where)]
    candidates = view.candidates(where)
    if own.arc is not None and where in own.arc:
        assert list(candidates) == [own.me]
        return
    claimants = {
        member
        for member in view.members
        if member != own.me and (claim := said.get(member, REGISTRY.founding_arc(member))) and where in claim
    }
    assert set(candidates) == claimants if claimants else 1 <= len(candidates) <= 2
