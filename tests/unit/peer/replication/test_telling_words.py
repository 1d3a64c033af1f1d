"""If one fails, a holder never hears what it is to hold, or hears of places of which its owner knows nothing."""

from __future__ import annotations

from itertools import pairwise

import hypothesis.strategies as st
from hypothesis import given

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.replication.telling_words import members_of, untold, words_for
from scenefold.wire import Member

P, A, B, C = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 5))
LAYOUTS: tuple[Layout, ...] = ((Location.from_number(7), Location.from_number(8)), (Location.from_number(9),))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


@st.composite
def placed(draw: st.DrawFn) -> Configurations:
    found = Configurations(P)
    for layout in LAYOUTS:
        bounds = sorted(draw(st.sets(st.integers(1, 99), max_size=6)))
        firsts, lasts = [0, *bounds], [*(bound - 1 for bound in bounds), 99]
        pieces = [(arc(*ends), draw(st.sampled_from([(A, B), (A, C), (B,)]))) for ends in zip(firsts, lasts, strict=True)]
        found = found.place(layout, pieces, 2)
    return found


@given(placed(), st.integers(1, 5), st.booleans())
def test_what_is_confirmed_is_told_and_nothing_is_said_twice(found: Configurations, entries_max: int, has_gap: bool) -> None:
    places = [arc(0, 39), arc(60, 99)] if has_gap else [arc(0, 99)]
    for holder in untold(found):
        words = words_for(found, holder, places, entries_max)
        ordered = sorted((word.scope for word in words), key=lambda scope: scope.first)
        assert all(left.last < right.first for left, right in pairwise(ordered))
        assert all(any(place.first <= scope.first and scope.last <= place.last for place in places) for scope in ordered)
        assert all(len(word.entries) <= max(2, entries_max) for word in words), "two layouts have an entry each of one place"
        if not has_gap:
            for word in words:
                found = found.confirm(word)
            assert holder not in untold(found)
            assert words_for(found, holder, places, entries_max) == []
    assert set(members_of(found)) <= {A, B, C}


def test_all_that_one_node_keeps_is_one_message() -> None:
    found = Configurations(P).place(LAYOUTS[0], [(arc(0, 9), (A, B)), (arc(10, 19), (B, C)), (arc(20, 29), (A, C))], 2)
    (word,) = words_for(found, A, [arc(0, 29)])
    assert word.scope == arc(0, 29)
    assert [entry.arc for entry in word.entries] == [arc(0, 9), arc(20, 29)]
