"""If one fails, something is told that may be lost, or something settled is told by nobody."""

from __future__ import annotations

import trio
import trio.testing

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.peer.line.unsettled import PAGE, Doubt, Pending, Unsettled, first_unsettled, name_of
from scenefold.store import Spot
from scenefold.wire import Member

ME = Member(NodeId(1), b"m" * 16)
LAYOUT = (Location.from_number(7),)
OTHER = (Location.from_number(8),)


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def pending(place: int, version: int = 1, object_id: bytes = b"") -> Pending:
    spot = Spot(RecordPlace(SceneId(1), SpaceId(2), Location.from_number(place)), object_id)
    return Pending(spot, bytes([version]) * 32, LAYOUT, 2, frozenset(), {ME}, 100)


def test_what_settles_settles_all_that_was_there_before_it() -> None:
    unsettled = Unsettled()
    first, second, third, elsewhere = pending(5), pending(5, 2), pending(5, 3), pending(6)
    for one in (first, second, third, elsewhere):
        unsettled.add(one)
    assert unsettled.settle(second) == [first, second]
    assert unsettled.of(name_of(first.spot)) == [third]
    assert [one.is_settled for one in (first, second, third, elsewhere)] == [True, True, False, False]
    assert unsettled.settle(first) == []
    assert len(unsettled) == 2


def test_what_was_there_before_the_start_is_older_than_all_else() -> None:
    unsettled = Unsettled()
    new, old = pending(5, 2), pending(5)
    unsettled.add(new)
    unsettled.add(old, is_oldest=True)
    assert unsettled.settle(new) == [old, new]
    assert unsettled.is_quiet


def test_what_was_not_stored_settles_nothing() -> None:
    unsettled = Unsettled()
    first, second = pending(5), pending(5, 2)
    unsettled.add(first)
    unsettled.add(second)
    unsettled.drop(second)
    assert (first.is_settled, second.is_settled) == (False, True)
    assert unsettled.of(name_of(first.spot)) == [first]


def test_a_piece_is_unsettled_by_the_homes_in_it() -> None:
    unsettled = Unsettled()
    name = b"o" * 16
    thing = pending(5, object_id=name)
    unsettled.add(thing)
    assert not unsettled.within(arc(5, 5)), "it lies there, but another decides about it"
    home = wanted_place(name)
    assert unsettled.within(Arc(home, home))
    assert list(unsettled.listed(SceneId(1), SpaceId(2), arc(0, 9))) == [[thing]], "it would be listed where it lies"
    assert not any(unsettled.listed(SceneId(1), SpaceId(3), arc(0, 9)))


def test_doubts_end_where_it_is_known_that_all_counts() -> None:
    unsettled = Unsettled()
    unsettled.doubt(Doubt(LAYOUT, arc(0, 9), rules=2))
    unsettled.doubt(Doubt(OTHER, arc(0, 9), rules=1))
    unsettled.doubt(Doubt(LAYOUT, arc(3, 4), rules=1))
    assert len(unsettled.doubts) == 2, "of that there is no doubt more than before"
    unsettled.clear(LAYOUT, arc(0, 4), rules=1)
    unsettled.clear(OTHER, arc(0, 9), rules=1)
    assert unsettled.is_doubted(LAYOUT, arc(0, 4)), "the second rule alone is not enough for it"
    assert not unsettled.is_doubted(OTHER, arc(0, 9))
    unsettled.clear(LAYOUT, arc(0, 4), rules=2)
    assert not unsettled.is_doubted(LAYOUT, arc(0, 4))
    assert unsettled.within(arc(4, 5))
    unsettled.clear(LAYOUT, arc(3, 20), rules=2)
    assert unsettled.is_quiet


def test_until_all_that_is_owed_was_read_anything_may_be_unsettled() -> None:
    unsettled = Unsettled(is_read=False)
    assert unsettled.within(arc(0, 0))
    assert not unsettled.is_quiet
    unsettled.read_all()
    assert not unsettled.within(arc(0, 0))


def test_who_waits_hears_of_it_and_waits_no_longer_than_he_said() -> None:
    unsettled = Unsettled()
    first, second = pending(5), pending(6)
    unsettled.add(first)
    unsettled.add(second)

    async def main() -> None:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(heard)
            await trio.testing.wait_all_tasks_blocked()
            unsettled.settle(first)
        assert await first_unsettled([first, second], trio.current_time()) is second

    async def heard() -> None:
        assert await first_unsettled([first], trio.current_time() + 1000.0) is None

    trio.run(main)


def test_what_is_walked_through_comes_a_page_at_a_time_as_it_was() -> None:
    unsettled = Unsettled()
    all_of_it = [pending(place) for place in range(2 * PAGE + 1)]
    for one in all_of_it:
        unsettled.add(one)
    pages = unsettled.listed(SceneId(1), SpaceId(2), arc(1, 3 * PAGE))
    unsettled.add(pending(3 * PAGE))
    unsettled.settle(all_of_it[-1])
    assert [len(page) for page in pages] == [PAGE - 1, PAGE, 1], "what comes later was in no list that was made before"


def test_a_place_is_unsettled_until_the_last_of_its_records_is() -> None:
    """Records of several spaces have one home."""
    unsettled = Unsettled()
    one, other = pending(5), pending(5)
    other.spot = Spot(RecordPlace(SceneId(1), SpaceId(3), Location.from_number(5)))
    for found in (one, other, second := pending(5, 2)):
        unsettled.add(found)
    unsettled.drop(one)
    unsettled.settle(other)
    assert unsettled.within(arc(5, 5)) and unsettled.within(arc(0, 9))
    unsettled.settle(second)
    assert not unsettled.within(arc(5, 5)) and not unsettled.within(arc(0, 9))
