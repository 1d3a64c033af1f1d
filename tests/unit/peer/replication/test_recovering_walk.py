"""If one fails, a node that lies keeps a gap from being recovered, or one that is honest is not heard to the end."""

from __future__ import annotations

from collections.abc import Sequence

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from scenefold.base.errors import PeerFault
from scenefold.base.ids import KeyId, NodeId, SceneId, SpaceId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.numbers import first_number
from scenefold.peer.line.holding import Holding
from scenefold.peer.replication.recovering_roll import Roll
from scenefold.peer.replication.recovering_walk import (
    ENTRIES_MAX,
    GIVEN_UP_MAX,
    NONSENSE_MAX,
    PATIENCE_S,
    TRIES_MAX,
    TRIES_MIN,
    Patience,
    Walk,
    spot_of_held,
)
from scenefold.wire import CustodyEntry, HeldListed, HeldRecord, Member, RecordVersion

ME, TELLER, DEAD, OTHER = (Member(NodeId(node), bytes([node]) * 16) for node in (1, 2, 3, 4))
NUMBER = first_number(7)
LAYOUT = (Location.from_number(5),)
MANAGED = SpaceId(3)


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


GAP = arc(100, 199)


def held(place: int, space: int = 1, object_id: bytes = b"") -> HeldRecord:
    version = RecordVersion(1, 1, KeyId(1), 1, bytes(32))
    return HeldRecord(SceneId(1), SpaceId(space), Location.from_number(place), object_id, version)


def custody(first: int, last: int, number: int = 5, *, members: tuple[Member, ...] = (DEAD, TELLER), whole: bool = True) -> CustodyEntry:
    where = arc(first, last)
    return CustodyEntry(LAYOUT, where.first, where.last, number, members, 1, whole)


def page(records: Sequence[HeldRecord] = (), entries: Sequence[CustodyEntry] = (), following: bytes | None = None) -> HeldListed:
    return HeldListed(0, tuple(records), tuple(entries), following)


def walked(*pages: HeldListed) -> Walk:
    walk = Walk(TELLER, GAP, NUMBER)
    for found in pages:
        walk.check(found)
        walk.move_on(found)
    return walk


def test_pages_go_on_where_the_last_one_ended() -> None:
    walk = walked(page([held(100), held(150)], [custody(0, 149)], b"b"))
    assert (walk.after, walk.is_over) == (b"b", False)
    last = page([held(151), held(100, space=2)], [custody(150, 300)])
    assert walk.check(last) == last.records
    walk.move_on(last)
    assert walk.is_over
    assert [entry.arc for entry in walk.entries] == [arc(100, 149), arc(150, 199)], "cut to what was asked for"


def test_what_is_looked_at_again_moves_nothing() -> None:
    """A page whose records do not come is asked for again."""
    walk = walked(page([held(100)], following=b"b"))
    for _ in range(3):
        walk.check(page([held(101)], following=b"c"))
    assert walk.after == b"b"


@pytest.mark.parametrize(
    "lie",
    [
        page([held(99)]),
        page([held(200)]),
        page([held(150), held(150)]),
        page([held(151), held(150)]),
        page([held(120)]),
        page([held(150, space=0)]),
        page([held(150)], following=b"b"),
        page([held(150)], following=b"a"),
        page([held(150)], following=b""),
        page(following=b"c"),
        page(entries=[custody(100, 150)]),
        page(entries=[custody(160, 170), custody(170, 180)]),
        page(entries=[custody(160, 170, NUMBER)]),
        page(entries=[custody(160, 170, members=(DEAD, OTHER))]),
        page(entries=[custody(160, 170, members=(TELLER, OTHER))]),
        page([held(150, MANAGED, b"\xff" * 16)]),
    ],
)
def test_nonsense_is_none(lie: HeldListed) -> None:
    walk = walked(page([held(120)], [custody(100, 159)], b"b"))
    with pytest.raises(PeerFault, match=r"names|goes on|answers for"):
        walk.check(lie)
    assert (walk.after, len(walk.entries)) == (b"b", 1)


def test_who_only_was_to_be_a_holder_need_not_be_named() -> None:
    assert len(walked(page(entries=[custody(100, 150, members=(DEAD, OTHER), whole=False)])).entries) == 1


def test_an_object_is_named_by_its_home() -> None:
    """Where it lies is its holder's affair, and may be outside of the gap."""
    walk = Walk(TELLER, WHOLE_LINE, NUMBER)
    found = page([held(900, MANAGED, b"\1" * 16), held(5, MANAGED, b"\2" * 16)])
    assert walk.check(found) == found.records
    assert spot_of_held(found.records[0]).home == Location(b"\1" * 16 + bytes(4))


def test_no_more_entries_than_an_owner_says() -> None:
    many = [custody(100, 100, members=(DEAD, TELLER)) for _ in range(ENTRIES_MAX + 1)]
    apart = [CustodyEntry((Location.from_number(1 + index),), e.first, e.last, 1, e.members, 1, True) for index, e in enumerate(many)]
    assert len(walked(page(entries=apart[:-1])).entries) == ENTRIES_MAX
    with pytest.raises(PeerFault):
        walked(page(entries=apart))


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(1, 3), st.integers(100, 199)), unique=True).map(sorted),
    st.lists(st.integers(1, 9), min_size=1),
)
def test_an_honest_list_is_heard_to_its_end(places: list[tuple[int, int]], sizes: list[int]) -> None:
    """However it is cut into pages."""
    records = [held(place, space) for space, place in places]
    walk, seen, at = Walk(TELLER, GAP, NUMBER), [], 0
    while not walk.is_over:
        size = sizes[at % len(sizes)]
        rest = records[at + size :]
        found = page(records[at : at + size], following=(at + size).to_bytes(4, "big") if rest else None)
        seen += walk.check(found)
        walk.move_on(found)
        at += size
    assert seen == records


any_page = st.builds(
    page,
    st.lists(st.builds(held, st.integers(98, 110), st.integers(1, 2)), max_size=4),
    st.lists(st.builds(custody, st.integers(98, 102), st.integers(103, 110)), max_size=2),
    st.none() | st.binary(min_size=0, max_size=1),
)


@settings(deadline=None)
@given(st.lists(any_page, max_size=60))
def test_whatever_is_said_gets_on(pages: list[HeldListed]) -> None:
    """Nothing is named twice, so who says more than there is has to make up new places without end."""
    walk, seen = Walk(TELLER, GAP, NUMBER), set[tuple[int, Location]]()
    for found in pages:
        try:
            records = walk.check(found)
        except PeerFault:
            continue
        named = [(record.space, record.location) for record in records]
        assert seen.isdisjoint(named)
        assert all(location in GAP for _, location in named)
        seen.update(named)
        walk.move_on(found)
        if walk.is_over:
            break
    assert all(entry.arc.intersection(GAP) == entry.arc for entry in walk.entries)


def test_who_does_not_deliver_is_asked_again_for_a_while() -> None:
    patience = Patience()
    pauses = [patience.failed(3, 0.0) for _ in range(TRIES_MAX)]
    assert pauses == [0.25, 0.5, 1.0, 2.0, 4.0, None]
    assert (patience.given_up, patience.is_over) == (3, False)
    assert patience.failed(1, 0.0) == 0.25


def test_what_is_denied_is_asked_for_once_more() -> None:
    """It may have been replaced by something newer, which is named then."""
    patience = Patience()
    assert [patience.failed(3, 0.0, are_denied=True) for _ in range(2)] == [0.25, None]
    assert patience.given_up == 3


def test_what_came_after_all_was_worth_the_wait() -> None:
    patience = Patience()
    for _ in range(2):
        patience.failed(1, 0.0)
    patience.delivered()
    assert patience.failed(1, 0.0) == 0.25


def test_no_page_is_given_up_after_one_answer_that_did_not_come() -> None:
    """However much patience that took: a frame that was too large for the line may have been on its way. What is denied is not."""
    patience = Patience()
    assert patience.failed(1024, PATIENCE_S + 11.0) == 0.25
    assert patience.failed(1024, 10.0) is None
    assert patience.failed(1, 10.0) == 0.25
    patience.delivered()
    assert patience.failed(1, 0.0, are_denied=True) is None
    assert patience.given_up == 1025


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(1, 1024), st.floats(0, 30)), min_size=1))
def test_nobody_is_waited_for_without_end(fails: list[tuple[int, float]]) -> None:
    """Whatever is named and does not come: in all it costs the patience, and then nothing but two tries each."""
    patience, waited_s, tries = Patience(), 0.0, 0
    for count, took_s in fails:
        pause_s = patience.failed(count, took_s)
        tries = 0 if pause_s is None else tries + 1
        if tries >= TRIES_MIN:
            assert waited_s + took_s <= PATIENCE_S
        waited_s += took_s + (pause_s or 0.0)
    for _ in range(GIVEN_UP_MAX + TRIES_MAX * GIVEN_UP_MAX):
        if patience.is_over:
            break
        patience.failed(1, 0.0)
    assert patience.is_over


def test_who_talks_nonsense_is_heard_no_further() -> None:
    patience = Patience()
    for _ in range(NONSENSE_MAX):
        patience.note_nonsense()
    assert not patience.is_over
    patience.note_nonsense()
    assert patience.is_over


def unrecovered() -> Copies:
    return Copies.of(ME).follow(Holding(), Holding(arc=arc(100, 299)))


def test_a_gap_is_recovered_once_all_were_heard_or_are_gone() -> None:
    roll = Roll(GAP, 7, ME, [OTHER, ME, TELLER, DEAD])
    assert roll.missing() == [TELLER, DEAD, OTHER]
    roll.hear(TELLER, walked(page(entries=[custody(100, 150, members=(DEAD, TELLER))])).entries)
    roll.lose(DEAD)
    assert roll.missing() == [OTHER]
    roll.hear(OTHER, ())
    copies = roll.recover(unrecovered())
    assert copies.unrecovered == (arc(200, 299),)
    assert copies.configurations.number == roll.number == NUMBER
    (segment,) = copies.configurations.segments
    assert (segment.arc, [found.number for found in segment.configurations]) == (arc(100, 150), [5])


@settings(deadline=None)
@given(st.permutations([TELLER, DEAD, OTHER]), st.lists(st.booleans(), min_size=3, max_size=3))
def test_in_whatever_order(order: list[Member], gone: list[bool]) -> None:
    """What is known in the end follows from what was said, and not from when."""
    said = walked(page(entries=[custody(100, 150, members=(DEAD, TELLER, OTHER))])).entries

    def recovered(members: Sequence[Member]) -> Copies:
        roll = Roll(GAP, 7, ME, [ME, TELLER, DEAD, OTHER])
        for member in members:
            assert member in roll.missing()
            if gone[member.node - 2]:
                roll.lose(member)
            else:
                roll.hear(member, said if member is TELLER else ())
        assert not roll.missing()
        return roll.recover(unrecovered())

    assert recovered(order) == recovered([TELLER, DEAD, OTHER])
