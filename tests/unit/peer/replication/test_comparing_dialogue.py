"""If one fails, two copies are taken for the same that are not, or a node that lies about sums is asked for ever."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from itertools import pairwise

import hypothesis.strategies as st
import pytest
from hypothesis import given

from scenefold.base.errors import PeerFault
from scenefold.base.ids import SceneId
from scenefold.base.limits import COMPARED_ARCS_MAX, COMPARED_RECORDS_MAX
from scenefold.base.location import LINE_LENGTH, WHOLE_LINE, Arc, Location
from scenefold.crypto import RecordPlace, wanted_place
from scenefold.peer.replication.comparing_dialogue import LISTS_MAX, Dialogue, Differences, Key, Known, Part, sixteenths
from scenefold.store import Spot
from unit.peer.scenes_made import SPACE

Side = dict[Key, Known]


def known(number: int, version: int, *, managed: bool = False) -> tuple[Key, Known]:
    place = Location.from_number(number)
    object_id = bytes(place[:16]) if managed else b""
    home = wanted_place(object_id) if managed else place
    return (home, object_id), Known((1, version, 0, 0, b""), Spot(RecordPlace(SceneId(1), SPACE, place), object_id))


def part(side: Side, arc: Arc, *, lists: bool) -> Part:
    inside = {key: found for key, found in side.items() if key[0] in arc}
    digests = [hashlib.sha256(repr((key, found.rank)).encode()).digest() for key, found in inside.items()]
    total = sum(int.from_bytes(digest[:16], "big") for digest in digests) % (1 << 128)
    few = lists and len(inside) <= COMPARED_RECORDS_MAX
    return Part(len(inside), total.to_bytes(32, "big"), inside if few else None)


def played(dialogue: Dialogue, own: Side, theirs: Side) -> tuple[Differences, int]:
    """To its end; the differences, and how many arcs were asked for."""
    found, arcs = Differences(), 0
    while (question := dialogue.question()) is not None:
        assert question is dialogue.question()
        assert 0 < len(question.arcs) <= (LISTS_MAX if question.lists else COMPARED_ARCS_MAX)
        arcs += len(question.arcs)
        step = dialogue.answer(
            [part(own, arc, lists=question.lists) for arc in question.arcs],
            [part(theirs, arc, lists=question.lists) for arc in question.arcs],
        )
        found.lacking.extend(step.lacking)
        found.newer.extend(step.newer)
    return found, arcs


# Places that lie beside each other, spread evenly, and at the ends.
numbers = st.one_of(
    st.integers(0, 600),
    st.integers(0, 2000).map(lambda part: part * (LINE_LENGTH // 2001)),
    st.integers(LINE_LENGTH - 5, LINE_LENGTH - 1),
)


@st.composite
def sides(draw: st.DrawFn) -> tuple[Side, Side]:
    """Two sets of versions that are mostly alike, small ones and large ones."""
    first, count, step = draw(numbers), draw(st.sampled_from([0, 3, 257, 700])), draw(st.sampled_from([1, 7, LINE_LENGTH // 1021]))
    both = [known((first + index * step) % LINE_LENGTH, 1) for index in range(count)]
    own, theirs = dict(both), dict(both)
    for side in (own, theirs):
        side.update(known(number, version) for number, version in draw(st.lists(st.tuples(numbers, st.integers(1, 3)), max_size=6)))
        side.update([known(draw(numbers), 1, managed=True)] if draw(st.booleans()) else [])
        for number in draw(st.lists(st.integers(0, max(0, count - 1)), max_size=3)):
            side.pop((Location.from_number((first + number * step) % LINE_LENGTH), b""), None)
    return own, theirs


def differences(own: Side, theirs: Side, arcs: list[Arc]) -> tuple[set[Known], set[Known]]:
    def more(one: Mapping[Key, Known], other: Mapping[Key, Known]) -> set[Known]:
        found = {key: mine for key, mine in one.items() if any(key[0] in arc for arc in arcs)}
        return {mine for key, mine in found.items() if key not in other or other[key].rank < mine.rank}

    return more(own, theirs), more(theirs, own)


@given(sides(), st.sets(numbers, max_size=4))
def test_it_finds_exactly_the_differences_in_few_questions(both: tuple[Side, Side], cuts: set[int]) -> None:
    own, theirs = both
    bounds = [0, *sorted(cuts - {0}), LINE_LENGTH]
    arcs = [Arc(Location.from_number(left), Location.from_number(right - 1)) for left, right in pairwise(bounds)][::2]
    dialogue = Dialogue(arcs)
    found, asked = played(dialogue, own, theirs)
    lacking, newer = differences(own, theirs, arcs)
    assert (set(found.lacking), set(found.newer)) == (lacking, newer)
    assert (len(found.lacking), len(found.newer)) == (len(lacking), len(newer)), "none twice"
    # A path of sixteenths to each difference and to each lot of records that lie beside each other, and the lists at its end.
    assert asked <= 2 * len(arcs) + 17 * 41 * (len(lacking) + len(newer))


@given(sides(), st.data())
def test_what_is_written_meanwhile_does_not_confuse_it(both: tuple[Side, Side], data: st.DataObject) -> None:
    """The owner's new records are owed: they need not be found. All that lay there at the beginning must be."""
    own, theirs = both
    begun = dict(own)
    dialogue = Dialogue([WHOLE_LINE])
    found: dict[Key, Known] = {}
    while (question := dialogue.question()) is not None:
        mine = [part(own, arc, lists=question.lists) for arc in question.arcs]
        written = [known(number, 9) for number in data.draw(st.lists(numbers, max_size=2))]
        own.update(written)
        theirs.update(data.draw(st.sampled_from([written, []])))
        for one in dialogue.answer(mine, [part(theirs, arc, lists=question.lists) for arc in question.arcs]).lacking:
            found[one.spot.home, one.spot.object] = one
            theirs[one.spot.home, one.spot.object] = one
    for key, mine in begun.items():
        assert key in theirs
        assert theirs[key].rank >= mine.rank


def test_equal_ones_cost_one_question() -> None:
    side = dict(known(number, 1) for number in range(1000))
    assert played(Dialogue([WHOLE_LINE]), side, dict(side)) == (Differences(), 1)


def test_how_much_is_missing_is_known_after_the_first_answer() -> None:
    dialogue = Dialogue([WHOLE_LINE])
    own = dict(known(number, 1) for number in range(1000))
    question = dialogue.question()
    assert question is not None
    dialogue.answer([part(own, WHOLE_LINE, lists=False)], [Part(400, bytes(32))])
    assert dialogue.missing == 600


@pytest.mark.parametrize("count", [300, 1 << 40])
def test_a_liar_is_not_asked_for_ever(count: int) -> None:
    """It says of every arc, however small, that much lies there."""
    dialogue = Dialogue([WHOLE_LINE])
    asked = 0
    try:
        while (question := dialogue.question()) is not None:
            asked += 1
            dialogue.answer([Part(0, bytes(32), {}) for _ in question.arcs], [Part(count, b"x" * 32) for _ in question.arcs])
    except PeerFault:
        assert asked < 50_000
        return
    raise AssertionError("it was believed")


def test_records_of_elsewhere_are_no_answer() -> None:
    dialogue = Dialogue([Arc(Location.from_number(0), Location.from_number(9))])
    assert dialogue.question() is not None
    dialogue.answer([Part(0, bytes(32))], [Part(1, b"x" * 32)])
    question = dialogue.question()
    assert question is not None
    assert question.lists
    with pytest.raises(PeerFault):
        dialogue.answer([Part(0, bytes(32), {})], [Part(1, b"x" * 32, dict([known(10, 1)]))])
    short = Dialogue([WHOLE_LINE])
    assert short.question() is not None
    with pytest.raises(PeerFault):
        short.answer([Part(0, bytes(32))], [])


@given(numbers, numbers)
def test_sixteenths_are_all_of_an_arc(one: int, other: int) -> None:
    arc = Arc(Location.from_number(min(one, other)), Location.from_number(max(one, other)))
    parts = sixteenths(arc)
    assert (parts[0].first, parts[-1].last) == (arc.first, arc.last)
    assert all(left.last.next() == right.first for left, right in pairwise(parts))
    assert len(parts) == min(16, arc.length)
