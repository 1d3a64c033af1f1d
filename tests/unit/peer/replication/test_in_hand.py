"""If this fails, what is still to be sent is purged elsewhere before it comes there, or nothing is ever purged again."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import RecordPlace
from scenefold.peer.line.unsettled import Pending, name_of
from scenefold.peer.replication.in_hand import InHand
from scenefold.store import Spot

PLACES = 4


@given(st.lists(st.tuples(st.integers(0, PLACES - 1), st.booleans()), max_size=40))
def test_a_record_is_in_hand_as_long_as_any_of_its_versions_is(steps: list[tuple[int, bool]]) -> None:
    found, model = InHand(), list[Pending]()
    for number, comes in steps:
        spot = Spot(RecordPlace(SceneId(1), SpaceId(2), Location.from_number(number)))
        here = [pending for pending in model if pending.spot == spot]
        if comes:
            model.append(Pending(spot, bytes(32), (), 2, frozenset(), set(), 100))
            found.add(model[-1])
        elif here:
            model.remove(here[0])
            found.remove(here[0])
        assert list(found) == model
        assert all(pending in found for pending in model)
        for place in range(PLACES):
            name = name_of(Spot(RecordPlace(SceneId(1), SpaceId(2), Location.from_number(place))))
            assert found.has_of(name) == any(name_of(pending.spot) == name for pending in model)
