"""If one fails, a holder answers for what it was told to forget, or forgets what it was told to keep."""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import CUSTODY_FLOORS_MAX, CUSTODY_KEPT_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.peer.copies.custody import Behind, Custody, Floor
from scenefold.peer.copies.custody_note import decode_custody, encode_custody
from scenefold.peer.copies.entries import Entry
from scenefold.wire import Member, pack_value, unpack_value

ONE: Layout = (Location.from_number(7),)
TWO: Layout = (Location.from_number(7), Location.from_number(9))
P, Q, A, B = (Member(NodeId(node), bytes([node]) * 16) for node in (1, 2, 3, 4))


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def place(number: int) -> Location:
    return Location.from_number(number)


def entry(owner: Member, number: int, where: Arc, layout: Layout = ONE, *, whole: bool = True) -> Entry:
    return Entry(layout, where, number, (owner, A, B), 2, whole)


def test_what_is_said_is_kept_and_cut_where_something_newer_is_said() -> None:
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))])
    custody = custody.set(P, 6, arc(40, 59), [entry(P, 6, arc(40, 49), whole=False)])
    assert custody.arcs(ONE) == [arc(0, 49), arc(60, 99)]
    assert [(found.arc, found.number) for found in custody.entries] == [(arc(0, 39), 5), (arc(40, 49), 6), (arc(60, 99), 5)]
    assert custody.answers(ONE, place(45)) is None
    assert custody.takes_from(P, ONE, place(45))
    assert not custody.takes_from(P, ONE, place(55))
    assert not custody.takes_from(Q, ONE, place(45))
    assert custody.at(TWO, place(45)) is None


def test_what_has_gone_does_not_come_back() -> None:
    """By a message that was on its way for long, of the same owner or of the one before."""
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))]).set(P, 7, arc(0, 99), [])
    assert custody.entries == ()
    for late in (5, 6, 7):
        with pytest.raises(Behind, match="number 7") as found:
            custody.set(P, late, arc(50, 120), [entry(P, late, arc(50, 99))])
        assert found.value.highest == 7
    assert custody.set(P, 5, arc(0, 99), []) == custody
    assert custody.set(Q, 8, arc(0, 99), [entry(Q, 8, arc(0, 99))]).at(ONE, place(3)) == entry(Q, 8, arc(0, 99))


def test_the_same_again_is_fine_and_another_word_under_the_number_is_not() -> None:
    said = [entry(P, 5, arc(0, 49)), entry(P, 4, arc(0, 99), TWO)]
    custody = Custody().set(P, 5, arc(0, 99), said)
    assert custody.set(P, 5, arc(0, 99), said) is custody
    with pytest.raises(Behind):
        custody.set(Q, 5, arc(0, 99), [entry(Q, 5, arc(0, 49))])
    with pytest.raises(Behind):
        custody.set(P, 5, arc(0, 99), said[:1])
    assert custody.set(P, 5, arc(0, 149), said).highest(arc(140, 149)) == 5


def test_an_entry_that_stays_keeps_its_number_and_one_that_is_new_needs_a_higher_one() -> None:
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))])
    custody = custody.set(P, 9, arc(0, 99), [entry(P, 5, arc(0, 99)), entry(P, 9, arc(0, 99), TWO)])
    assert [found.number for found in custody.entries] == [5, 9]
    with pytest.raises(Behind, match="number 9"):
        custody.set(P, 11, arc(0, 99), [entry(P, 6, arc(0, 99))])


def test_only_an_owner_speaks_for_itself_and_within_its_scope() -> None:
    for said, scope, number in (
        (entry(Q, 5, arc(0, 9)), arc(0, 9), 5),
        (entry(P, 5, arc(0, 10)), arc(0, 9), 5),
        (entry(P, 6, arc(0, 9)), arc(0, 9), 5),
    ):
        with pytest.raises(Refused):
            Custody().set(P, number, scope, [said])


def test_a_promise_fences_but_what_is_whole_still_answers() -> None:
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))]).promise(arc(20, 29), 100)
    assert custody.takes_from(P, ONE, place(19))
    assert not custody.takes_from(P, ONE, place(20))
    assert custody.answers(ONE, place(20)) is not None
    assert custody.promise(arc(20, 29), 100) == custody
    with pytest.raises(Behind):
        custody.set(P, 99, arc(0, 99), [])
    assert not custody.set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))]).takes_from(P, ONE, place(20))
    assert custody.set(Q, 100, arc(20, 29), [entry(Q, 100, arc(20, 29))]).takes_from(Q, ONE, place(20))


def test_a_promise_is_not_given_to_who_comes_after_a_later_owner() -> None:
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))])
    for number in (4, 5):
        with pytest.raises(Behind) as behind:
            custody.promise(arc(20, 29), number)
        assert behind.value.highest == 5
    assert not custody.promise(arc(20, 29), 6).takes_from(P, ONE, place(20))


def test_a_floor_that_is_high_already_promises_enough() -> None:
    """Floors of neighbours become one with the higher number, which must not keep anybody from recovering a place."""
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99))]).promise(arc(0, 99), 100)
    again = custody.promise(arc(0, 99), 50)
    assert again == custody
    assert again.highest(arc(0, 99)) == 99


def test_who_owns_a_place_holds_it_for_nobody_and_forgets_no_number() -> None:
    custody = Custody().set(P, 5, arc(0, 99), [entry(P, 5, arc(0, 99)), entry(P, 5, arc(0, 99), TWO)]).claim(arc(50, 149))
    assert custody.arcs(ONE) == custody.arcs(TWO) == [arc(0, 49)]
    with pytest.raises(Behind):
        custody.set(P, 5, arc(50, 99), [entry(P, 5, arc(50, 99))])
    assert Custody().claim(arc(0, 9)) == Custody()


def test_more_pieces_than_are_kept_are_refused() -> None:
    said = [entry(P, 1 + index % 2, arc(2 * index, 2 * index)) for index in range(CUSTODY_KEPT_MAX + 1)]
    with pytest.raises(Refused, match="takes no more"):
        Custody().set(P, 2, arc(0, 3 * CUSTODY_KEPT_MAX), said)
    assert len(Custody().set(P, 2, arc(0, 3 * CUSTODY_KEPT_MAX), said[1:]).entries) == CUSTODY_KEPT_MAX


def test_floors_that_are_too_many_become_one_and_none_sinks() -> None:
    custody = Custody()
    for index in range(CUSTODY_FLOORS_MAX + 20):
        custody = custody.set(P, 1 + index % 3, arc(10 * index, 10 * index), [])
    assert len(custody.floors) <= CUSTODY_FLOORS_MAX
    assert all(custody.highest(arc(10 * index, 10 * index)) >= 1 + index % 3 for index in range(CUSTODY_FLOORS_MAX + 20))


# ---------------------------------------------------------------------------------------- beside a simple one

Said = tuple[int, Member, int, int, list[tuple[int, int, bool, int]]]
words = st.tuples(
    st.sampled_from(["set", "set", "set", "promise", "claim"]),
    st.sampled_from([P, Q]),
    st.integers(1, 9),
    st.tuples(st.integers(0, 11), st.integers(0, 11)).map(lambda ends: (min(ends), max(ends))),
    st.lists(
        st.tuples(st.integers(0, 11), st.booleans(), st.sampled_from([ONE, TWO]), st.integers(0, 2)),
        max_size=5,
        unique_by=lambda x: (x[0], x[2]),
    ),
)


@settings(max_examples=400, deadline=None)
@given(st.lists(words, max_size=12))
def test_each_place_goes_its_own_way(said: list[tuple[str, Member, int, tuple[int, int], list[tuple[int, bool, Layout, int]]]]) -> None:
    """Custody of arcs is that of their places, and its note brings it back."""
    custody = Custody()
    kept: dict[tuple[Layout, int], Entry] = {}
    floors = dict.fromkeys(range(12), 0)
    for kind, owner, number, (first, last), wanted in said:
        scope = range(first, last + 1)
        if kind == "claim":
            custody = custody.claim(arc(first, last))
            kept = {key: found for key, found in kept.items() if key[1] not in scope}
            continue
        if kind == "promise":
            if any(found.number >= number for (_, index), found in kept.items() if index in scope):
                with pytest.raises(Behind):
                    custody.promise(arc(first, last), number)
                continue
            custody = custody.promise(arc(first, last), number)
            kept = {key: replace(found, fenced=found.fenced or key[1] in scope) for key, found in kept.items()}
            floors |= {index: max(floors[index], number - 1) for index in scope}
            continue
        entries = {
            (layout, index): entry(owner, max(1, number - less), arc(index, index), layout, whole=whole)
            for index, whole, layout, less in wanted
            if index in scope
        }
        plain = {key: replace(found, fenced=False) for key, found in kept.items()}
        fits = True
        after = {key: found for key, found in kept.items() if key[1] not in scope}
        for index in scope:
            for layout in (ONE, TWO):
                new, old = entries.get((layout, index)), plain.get((layout, index))
                if floors[index] >= number:
                    fits &= new == old
                    after |= {(layout, index): kept[layout, index]} if old is not None else {}
                elif new is not None:
                    fits &= new.number > floors[index] or new == old
                    after[layout, index] = new
        if not fits:
            with pytest.raises(Behind):
                custody.set(owner, number, arc(first, last), list(entries.values()))
            continue
        custody = custody.set(owner, number, arc(first, last), list(entries.values()))
        kept = after
        floors |= {index: max(floors[index], number) for index in scope}
        for index in range(12):
            assert custody.highest(arc(index, index)) == floors[index]
            for layout in (ONE, TWO):
                found = custody.at(layout, place(index))
                assert (None if found is None else replace(found, arc=arc(index, index))) == kept.get((layout, index))
        assert decode_custody(encode_custody(custody)) == custody


# --------------------------------------------------------------------------------------------------------- the note


def some() -> Custody:
    said = [entry(P, 5, arc(0, 49)), entry(P, 4, arc(0, 99), TWO, whole=False)]
    return Custody().set(P, 5, arc(0, 99), said).promise(arc(0, 9), 100)


@pytest.mark.parametrize(
    "change",
    [
        {"v": 2}, {"more": 1}, {"entries": [[0]]}, {"members": []}, {"layouts": [[bytes(20)]]}, {"entries": None}, {"floors": [[b"", b"", 1]]},
        {"members": [[1, b"short"]] * 3},
    ],
)  # fmt: skip
def test_a_damaged_note_is_said_to_be_damaged(change: dict[str, object]) -> None:
    value = unpack_value(encode_custody(some()))
    assert isinstance(value, dict)
    with pytest.raises(DamagedData):
        decode_custody(pack_value({**value, **change}, what="note"))


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_note_with_changed_bytes_is_damaged_or_another_one(data: st.DataObject) -> None:
    note = bytearray(encode_custody(some()))
    index = data.draw(st.integers(0, len(note) - 1))
    note[index] ^= data.draw(st.integers(1, 255))
    try:
        assert encode_custody(decode_custody(bytes(note))) == bytes(note)
    except DamagedData:
        return


def test_a_note_that_says_a_place_twice_is_damaged() -> None:
    twice = Custody(entries=(entry(P, 5, arc(0, 49)), entry(P, 6, arc(49, 60))), floors=(Floor(arc(0, 60), 6),))
    with pytest.raises(DamagedData, match="not in order"):
        decode_custody(encode_custody(twice))
