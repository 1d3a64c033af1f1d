"""If one fails, an owner counts out who can still be read, or never gets a segment to its new holders."""

from __future__ import annotations

from itertools import pairwise

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import CONFIGURATIONS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.configurations_note import decode_configurations, encode_configurations
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.wire import Member, pack_value, unpack_value

ONE: Layout = (Location.from_number(7), Location.from_number(8))
TWO: Layout = (Location.from_number(9),)
P, Q, A, B, C, D = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 7))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def tell(found: Configurations, *deaf: Member) -> Configurations:
    """Everybody hears and confirms what is said."""
    for word in found.untold():
        if word.holder not in deaf:
            found = found.confirm(word)
    return found


def compare(found: Configurations, *deaf: Member) -> Configurations:
    for segment in found.segments:
        for holder in segment.holders(found.me):
            entry = segment.wanted(holder, found.me)
            assert entry is not None
            found = found if holder in deaf else found.compare(holder, entry)
    return found


def changed(found: Configurations, *holders: Member, where: Arc | None = None, needed: int = 2) -> Configurations:
    """All the way to another configuration."""
    found = tell(found.place(ONE, [(where or arc(0, 99), holders)], needed))
    return tell(compare(found).activate(lambda _: []))


def only(found: Configurations) -> Segment:
    (segment,) = found.segments
    return segment


def test_new_holders_are_filled_first_and_answer_once_they_have_everything() -> None:
    found = Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2)
    assert [(word.holder, [entry.whole for entry in word.entries]) for word in found.untold()] == [(A, [False]), (B, [False])]
    assert found.activate(lambda _: []) is found
    assert compare(found).activate(lambda _: []).segments == found.segments, "nobody has confirmed that he is filled for this owner"
    found = tell(found)
    assert found.untold() == []
    assert compare(found, B).activate(lambda _: []).segments == compare(found, B).segments
    found = compare(found).activate(lambda _: [])
    assert [(word.holder, [entry.whole for entry in word.entries]) for word in found.untold()] == [(A, [True]), (B, [True])]
    assert only(tell(found)).is_idle(P)


def test_nobody_is_told_to_hold_what_was_placed_elsewhere() -> None:
    found = Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2).place(TWO, [(arc(0, 49), (A,)), (arc(50, 99), (C,))], 2)
    told = {word.holder: [(entry.layout, entry.arc) for entry in word.entries] for word in found.untold() if word.scope == arc(0, 99)}
    assert told[B] == [(ONE, arc(0, 99))]
    assert told[A] == [(ONE, arc(0, 99)), (TWO, arc(0, 49))]


def test_who_owes_too_much_keeps_a_configuration_from_becoming_active() -> None:
    found = compare(tell(Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2)))
    assert found.activate(lambda _: [{A}, {A, B}]).segments == found.segments
    assert only(found.activate(lambda _: [{A}, {B}, {C}])).active(P) is not None
    found = compare(tell(Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 3)))
    assert found.activate(lambda _: [{A}]).segments == found.segments


def test_a_write_counts_when_enough_of_all_that_may_be_read_have_it() -> None:
    found = changed(Configurations(P), A, B)
    assert not only(found).is_settled({P}, 2, P)
    assert only(found).is_settled({P, A}, 2, P)
    assert not only(found).is_settled({P, C}, 2, P), "who is no holder may delete it"
    changing = only(found.place(ONE, [(arc(0, 99), (B, C))], 2))
    assert not changing.is_settled({P, A}, 2, P), "A is to go: it may stand where no copy may"
    assert changing.is_settled({P, B}, 2, P)
    assert changing.is_settled({P, A, C}, 2, P)
    found = compare(tell(found.place(ONE, [(arc(0, 99), (C, D))], 2))).activate(lambda _: [])
    assert not only(found).is_settled({P, C}, 2, P), "A and B may still be read, and have not heard of it"
    assert only(tell(found, A, C, D)).is_settled({P, C}, 2, P), "A alone is not believed"
    assert [kept.members for kept in only(tell(found)).configurations] == [(P, C, D)]


def test_members_hear_before_those_who_are_none_any_more() -> None:
    found = changed(Configurations(P), A, B)
    found = compare(tell(found.place(ONE, [(arc(0, 99), (B, C))], 2))).activate(lambda _: [])
    assert [(word.holder, bool(word.entries)) for word in found.untold()] == [(B, True), (C, True), (A, False)]


def test_who_left_and_comes_back_is_compared_anew() -> None:
    found = changed(changed(Configurations(P), A, B), B, C)
    found = tell(found.place(ONE, [(arc(0, 99), (A, B))], 2))
    assert A not in only(found).sound
    assert B in only(found).sound
    found = found.place(ONE, [(arc(0, 99), (B, D))], 2).place(ONE, [(arc(0, 99), (A, B))], 2)
    late = Entry(ONE, arc(0, 99), found.number - 3, (P, A, B), 2, whole=False)
    assert found.compare(A, late) is found, "that was before it left"


def test_a_placement_that_returns_ends_the_change() -> None:
    found = changed(Configurations(P), A, B)
    assert found.place(ONE, [(arc(0, 99), (B, A))], 2) is found
    back = tell(found.place(ONE, [(arc(0, 99), (B, C))], 2)).place(ONE, [(arc(0, 99), (A, B))], 2)
    assert only(back).change is None
    assert [(word.holder, word.entries) for word in back.untold()] == [(C, ())]
    assert only(tell(back)).is_idle(P)


def test_neighbours_with_the_same_holders_become_one() -> None:
    found = changed(Configurations(P), A, B, where=arc(0, 49))
    found = changed(found, A, C, where=arc(50, 79))
    found = changed(found, A, B, where=arc(80, 99))
    assert found.gather() is found
    found = changed(found, A, B, where=arc(50, 79))
    assert [segment.arc for segment in found.segments] == [arc(0, 49), arc(50, 79), arc(80, 99)]
    gathered = found.gather()
    assert gathered.untold() == [], "nobody hears of it before it is done"
    assert gathered.gather() is gathered
    done = gathered.activate(lambda _: [])
    assert only(tell(done)).arc == arc(0, 99)
    assert only(tell(done)).is_idle(P)
    assert tell(done).gather().segments == tell(done).segments
    late = gathered.activate(lambda segment: None if segment.arc == arc(50, 79) else [])
    assert len(tell(late).segments) == 3, "one of them waits for what is owed"
    assert only(tell(tell(late.activate(lambda _: [])).gather().activate(lambda _: []))).arc == arc(0, 99)


def test_a_removed_node_is_asked_for_nothing_and_read_by_nobody() -> None:
    found = changed(Configurations(P), A, B).remove(A)
    assert only(found).is_closed(only(found).configurations[0], P)
    assert only(found).holders(P) == [B]
    found = changed(found, B)
    assert only(found).active(P) == only(found).newest
    assert only(found).newest is not None
    assert only(found).newest.members == (P, B)  # type: ignore[union-attr]


def test_who_is_removed_before_it_becomes_a_holder_is_counted_out_once() -> None:
    found = Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2).remove(A)
    assert found.remove(A) is found
    assert {word.holder for word in found.untold()} == {B}
    found = tell(found.place(ONE, [(arc(0, 99), (B,))], 2))
    assert only(compare(found).activate(lambda _: [])).newest is not None
    assert A not in {member for member, _ in only(found).confirmed}


def test_a_number_that_somebody_has_met_is_passed() -> None:
    found = tell(Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2), B)
    (word,) = found.untold()
    found = found.met(word, 41)
    assert {said.number for said in found.untold()} == {42}
    assert {entry.number for said in found.untold() for entry in said.entries} == {42}
    assert only(tell(compare(tell(found)).activate(lambda _: []))).is_idle(P)
    active = changed(Configurations(P), A, B)
    assert active.met(active.word(A, arc(0, 99)), 0) is active


def test_pieces_go_with_what_may_be_read_of_them() -> None:
    giver = changed(Configurations(P), A, B)
    rest, number, pieces = giver.give(arc(40, 99))
    assert [segment.arc for segment in rest.segments] == [arc(0, 39)]
    receiver = Configurations(Q).take(number, pieces)
    segment = only(receiver)
    assert segment.arc == arc(40, 99)
    assert receiver.untold() == [], "what is there goes on until it is known what shall be"
    receiver = receiver.place(ONE, [(arc(40, 99), (P, A))], 2)
    assert {word.holder for word in receiver.untold()} == {P, A, B}, "B is over for what was once it has heard of the new owner"
    assert all(word.number > number for word in receiver.untold())
    assert not only(receiver).is_settled({Q, P}, 2, Q)
    assert only(receiver).is_settled({Q, P, A}, 2, Q)
    assert only(tell(receiver, A, P)).is_settled({Q, P}, 2, Q), "P answers for nothing by right of an owner that it was, and B has heard"
    receiver = tell(compare(tell(receiver)).activate(lambda _: []))
    assert only(receiver).is_idle(Q)
    assert [kept.members for kept in only(receiver).configurations] == [(Q, P, A)]


def test_a_receiver_that_was_a_holder_is_none_any_more() -> None:
    _, number, pieces = changed(Configurations(P), A, Q).give(arc(0, 99))
    assert only(Configurations(Q).take(number, pieces)).is_closed(pieces[0].configurations[0], Q)


def test_a_piece_that_comes_back_is_an_inherited_one_where_somebody_was_told_otherwise_meanwhile() -> None:
    mine = changed(Configurations(P), A, B, needed=3)
    _, number, passed = mine.give(arc(0, 99))
    other = Configurations(Q).take(number, passed).place(ONE, [(arc(0, 99), (A, C))], 3)
    other = tell(other, B)
    _, number, passed = other.give(arc(0, 99))
    back = Configurations(P, mine.number).take(number, passed)
    assert only(back).newest == only(mine).newest and only(back).active(P) is None
    back = tell(changed(back, A, B, needed=3))
    assert only(back).is_idle(P)


def test_who_was_told_by_an_owner_in_between_hears_that_it_holds_nothing_any_more() -> None:
    mine = changed(Configurations(P), A, B)
    _, number, passed = mine.give(arc(0, 99))
    _, number, passed = tell(Configurations(Q).take(number, passed).place(ONE, [(arc(0, 99), (C, D))], 2), A, B).give(arc(0, 99))
    back = Configurations(P, mine.number).take(number, passed).place(ONE, [(arc(0, 99), (A, B))], 2)
    assert only(back).active(P) is None, "A and B may have heard of another owner, and have not said so"
    back = compare(tell(back)).activate(lambda _: [])
    assert {word.holder: len(word.entries) for word in back.untold()} == {A: 1, B: 1, C: 0, D: 0, Q: 0}
    assert only(tell(back)).is_idle(P)


def test_who_was_filled_for_an_inherited_piece_hears_that_it_holds_nothing_once_the_last_that_had_it_are_gone() -> None:
    """Nobody of the owner's own configuration is left, so it counts again: those who went on under the next one need not any more."""
    mine = changed(Configurations(P), A, B)
    _, number, passed = mine.give(arc(0, 99))
    _, number, passed = tell(Configurations(Q).take(number, passed).place(ONE, [(arc(0, 99), (C, D))], 2), A, B).give(arc(0, 99))
    back = tell(Configurations(P, mine.number).take(number, passed).place(ONE, [(arc(0, 99), (C,))], 2), A, B)
    assert {member for member in (Q, D) if only(back).wanted(member, P)} == {Q, D}
    back = back.remove(A).remove(B)
    assert {word.holder: len(word.entries) for word in back.untold()} == {D: 0, Q: 0}
    told = compare(tell(back)).activate(lambda _: [])
    assert only(tell(told)).is_idle(P) and only(told).holders(P) == [C]


class Kept:
    """What holders keep of what they are told."""

    def __init__(self, *holders: Member) -> None:
        self.of = dict.fromkeys(holders, Custody())

    def hear(self, found: Configurations) -> None:
        for word in found.untold():
            if word.holder in self.of:
                self.of[word.holder] = self.of[word.holder].set(found.me, word.number, word.scope, word.entries)

    def take_from(self, owner: Member) -> bool:
        return all(custody.takes_from(owner, ONE, arc(0, 0).first) for custody in self.of.values())


def filled(found: Configurations, kept: Kept) -> Configurations:
    """All the way to a configuration of A and B, who hear of it and take what is written."""
    found = found.place(ONE, [(arc(0, 99), (A, B))], 2)
    kept.hear(found)
    assert kept.take_from(found.me), "before they have heard of this owner nothing can be brought to them"
    found = compare(tell(found)).activate(lambda _: [])
    kept.hear(found)
    return tell(found)


def test_who_may_have_heard_of_an_owner_in_between_hears_who_owns_the_piece_again() -> None:
    kept = Kept(A, B)
    mine = filled(Configurations(P), kept)
    _, number, passed = mine.give(arc(0, 99))
    other = Configurations(Q).take(number, passed).place(ONE, [(arc(0, 99), (A, B))], 2)
    # Their answers are lost.
    kept.hear(other)
    _, number, passed = other.give(arc(0, 99))
    back = filled(Configurations(P, mine.number).take(number, passed), kept)
    assert only(back).is_idle(P)
    assert kept.take_from(P)


def test_who_recovers_its_own_former_piece_tells_those_who_have_promised_to_take_nothing() -> None:
    kept = Kept(A, B)
    rest, _, _ = filled(Configurations(P), kept).give(arc(0, 99))
    # Who was to have it is gone before it has told anybody.
    kept.of = {holder: custody.promise(arc(0, 99), 1000) for holder, custody in kept.of.items()}
    heard = {holder: custody.within(arc(0, 99)) for holder, custody in kept.of.items()}
    back = filled(rest.adopt(arc(0, 99), heard, 1000), kept)
    assert only(back).is_idle(P)
    assert kept.take_from(P)


def test_a_gap_is_adopted_with_all_that_was_met_there() -> None:
    whole = Entry(ONE, arc(0, 59), 5, (P, A, B), 2, whole=True)
    newer = Entry(ONE, arc(20, 39), 8, (P, A, C), 2, whole=True)
    filling = Entry(ONE, arc(60, 99), 6, (P, A, D), 2, whole=False)
    heard = {Q: [], A: [Entry(ONE, arc(0, 19), 5, (P, A, B), 2, whole=True), newer], B: [whole], C: [], D: [filling]}
    found = Configurations(Q).adopt(arc(10, 99), heard, 1000)
    assert found.number >= 1000
    assert [(segment.arc, [kept.number for kept in segment.configurations]) for segment in found.segments] == [
        (arc(10, 19), [5]),
        (arc(20, 39), [5, 8]),
        (arc(40, 59), [5]),
        (arc(60, 99), []),
    ]
    both = found.segments[1]
    assert both.is_closed(both.configurations[0], Q), "P is gone, and A answers under another number"
    assert both.is_closed(both.configurations[1], Q), "C has promised to take nothing of P any more"
    assert not found.segments[0].is_closed(found.segments[0].configurations[0], Q)
    placed = found.place(ONE, [(arc(10, 99), (A, C))], 2)
    said = {(word.holder, word.scope) for word in placed.untold()}
    assert (D, arc(60, 99)) in said, "who was filled for the one before hears that there is a new owner"
    done = tell(compare(tell(placed)).activate(lambda _: []))
    assert all(segment.is_idle(Q) for segment in done.segments)
    assert all([kept.members for kept in segment.configurations] == [(Q, A, C)] for segment in done.segments)


def test_segments_are_cut_where_holders_change_and_joined_where_nothing_tells_them_apart() -> None:
    found = tell(Configurations(P).place(ONE, [(arc(0, 49), (A, B)), (arc(50, 99), (A, C))], 2))
    assert [segment.arc for segment in found.segments] == [arc(0, 49), arc(50, 99)]
    assert found.at(ONE, Location.from_number(49)) is found.segments[0]
    assert found.at(ONE, Location.from_number(100)) is found.at(TWO, Location.from_number(3)) is None
    one = Configurations(P).place(ONE, [(arc(0, 49), (A, B)), (arc(50, 99), (A, B))], 2)
    assert [segment.arc for segment in one.segments] == [arc(0, 99)]


def test_a_word_says_all_of_its_scope() -> None:
    found = Configurations(P).place(ONE, [(arc(0, 99), (A, B))], 2).place(TWO, [(arc(30, 99), (A,))], 2)
    (word,) = [word for word in found.untold() if word.holder == A and word.scope == arc(0, 99)]
    assert [(entry.layout, entry.arc) for entry in word.entries] == [(ONE, arc(0, 99)), (TWO, arc(30, 99))]


def test_too_many_pieces_are_refused() -> None:
    pieces = [(arc(2 * index, 2 * index), (A, B) if index % 2 else (A, C)) for index in range(CONFIGURATIONS_MAX + 1)]
    with pytest.raises(Refused, match="falls into more"):
        Configurations(P).place(ONE, pieces, 2)
    full = Configurations(P).place(ONE, pieces[1:], 2)
    assert full.place(ONE, pieces[1:], 2) is full
    assert len(full.untold()) == 2 * CONFIGURATIONS_MAX
    assert decode_configurations(encode_configurations(full)) == full


# ------------------------------------------------------------------------------------------- places and pieces

cuts = st.sets(st.integers(1, 11), max_size=3)
acts = st.one_of(
    st.tuples(st.just("place"), cuts, st.lists(st.permutations([A, B, C]), min_size=4, max_size=4), st.integers(1, 3)),
    st.tuples(
        st.sampled_from(["tell", "compare", "activate", "remove", "give"]),
        st.sampled_from([A, B, C]),
        st.integers(0, 11),
        st.integers(0, 11),
    ),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(acts, max_size=12))
def test_each_place_is_as_if_it_were_alone(said: list[tuple[str, object, object, int]]) -> None:
    """What is cut, given, taken and joined: every place has the configurations that it has without any of that."""
    found = Configurations(P)
    alone = {index: Configurations(P) for index in range(12)}
    for act in said:
        match act:
            case "place", set() as bounds, list() as holders, int() as needed:
                edges = [0, *sorted(bounds), 12]
                pieces = [(arc(first, last - 1), tuple(holders[index][:2])) for index, (first, last) in enumerate(pairwise(edges))]
                found = found.place(ONE, pieces, needed)
                alone = {
                    index: one.place(
                        ONE, [(arc(index, index), next(held for where, held in pieces if Location.from_number(index) in where))], needed
                    )
                    for index, one in alone.items()
                }
            case "tell", deaf, _, _:
                found = tell(found, deaf)  # type: ignore[arg-type]
                alone = {index: tell(one, deaf) for index, one in alone.items()}  # type: ignore[arg-type]
            case "compare", deaf, _, _:
                found = compare(found, deaf)  # type: ignore[arg-type]
                alone = {index: compare(one, deaf) for index, one in alone.items()}  # type: ignore[arg-type]
            case "activate", debtor, _, _:
                found = found.activate(lambda _, debtor=debtor: [{debtor}])  # type: ignore[misc]
                alone = {index: one.activate(lambda _, debtor=debtor: [{debtor}]) for index, one in alone.items()}  # type: ignore[misc]
            case "remove", member, _, _:
                found = found.remove(member)  # type: ignore[arg-type]
                alone = {index: one.remove(member) for index, one in alone.items()}  # type: ignore[arg-type]
            case "give", _, int() as one_end, other_end:
                first, last = sorted((one_end, other_end))
                found, number, pieces_given = found.give(arc(first, last))
                found = found.take(number, pieces_given)
                for index in range(first, last + 1):
                    rest, number, given_alone = alone[index].give(arc(index, index))
                    alone[index] = rest.take(number, given_alone)
        assert decode_configurations(encode_configurations(found)) == found
        for index, one in alone.items():
            here, there = found.at(ONE, Location.from_number(index)), one.at(ONE, Location.from_number(index))
            assert (here is None) == (there is None)
            if here is not None and there is not None:
                assert [(kept.members, kept.needed) for kept in here.configurations] == [
                    (kept.members, kept.needed) for kept in there.configurations
                ]
                assert here.sound == there.sound
                assert set(here.holders(P)) == set(there.holders(P))
                assert set(here.untold(P)) == set(there.untold(P))


# --------------------------------------------------------------------------------------------------------- the note


def some() -> Configurations:
    found = changed(Configurations(P), A, B).place(ONE, [(arc(20, 59), (B, C))], 2)
    return tell(found, C).remove(A)


@pytest.mark.parametrize(
    "change", [{"v": 2}, {"more": 1}, {"me": 9}, {"number": 0}, {"segments": [[0]]}, {"members": []}, {"layouts": None}, {"segments": None}]
)
def test_a_damaged_note_is_said_to_be_damaged(change: dict[str, object]) -> None:
    value = unpack_value(encode_configurations(some()))
    assert isinstance(value, dict)
    with pytest.raises(DamagedData):
        decode_configurations(pack_value({**value, **change}, what="note"))


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_a_note_with_changed_bytes_is_damaged_or_another_one(data: st.DataObject) -> None:
    note = bytearray(encode_configurations(some()))
    index = data.draw(st.integers(0, len(note) - 1))
    note[index] ^= data.draw(st.integers(1, 255))
    try:
        assert encode_configurations(decode_configurations(bytes(note))) == bytes(note)
    except DamagedData:
        return
