"""If this fails, two owners of a place pass for one, or a clean handover is blamed."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.location import FIRST, LAST, WHOLE_LINE, Arc, Location, arcs_between, even_right_bounds
from scenefold.simulation.lineage import Gain, Holder, Lineage, Way, tiling_problems

A, B, C = (Holder(slot, bytes([slot]) * 16) for slot in range(3))
MIDDLE = Location.from_number(1 << 159)
LEFT, RIGHT = Arc(FIRST, Location.from_number(MIDDLE.number - 1)), Arc(MIDDLE, LAST)
QUARTER = Arc(Location.from_number(3 << 158), LAST)
THIRD = Arc(MIDDLE, Location.from_number((3 << 158) - 1))


def founded() -> Lineage:
    lineage = Lineage()
    for holder, arc in ((A, LEFT), (B, RIGHT)):
        gains, wrong = lineage.changed(holder, arc, 0.0)
        assert [gain.way for gain in gains] == [Way.FOUNDING]
        assert not wrong
    return lineage


def ways(gains: list[Gain]) -> list[Way]:
    return [gain.way for gain in gains]


def test_a_handover_is_release_then_claim() -> None:
    lineage = founded()
    assert lineage.changed(B, THIRD, 1.0, lambda _arc: C) == ([], [])
    gains, wrong = lineage.changed(C, QUARTER, 2.0)
    assert (ways(gains), gains[0].arc, wrong) == ([Way.HANDOVER], QUARTER, [])
    assert lineage.holder_of(LAST).holder == C


def test_a_claim_before_the_release_is_wrong() -> None:
    _, wrong = founded().changed(C, QUARTER, 1.0)
    assert [gain.before.holder for gain in wrong] == [B]


def test_a_claim_of_what_went_to_another_is_wrong() -> None:
    lineage = founded()
    lineage.changed(B, THIRD, 1.0, lambda _arc: C)
    _, wrong = lineage.changed(A, QUARTER, 2.0)
    assert len(wrong) == 1


def test_a_removed_nodes_arc_is_adopted() -> None:
    lineage = founded()
    lineage.gone(B)
    gains, wrong = lineage.changed(A, WHOLE_LINE, 3.0)
    assert (ways(gains), gains[0].arc, wrong) == ([Way.ADOPTION], RIGHT, [])


def test_what_a_removed_receiver_never_claimed_is_its_givers_and_nobody_elses() -> None:
    lineage = founded()
    lineage.changed(B, THIRD, 1.0, lambda _arc: C)
    lineage.gone(C)
    gains, wrong = lineage.changed(B, RIGHT, 2.0)
    assert (ways(gains), wrong) == ([Way.AGAIN], [])
    lineage = founded()
    lineage.changed(B, None, 1.0, lambda _arc: C)
    lineage.gone(C)
    gains, wrong = lineage.changed(A, WHOLE_LINE, 2.0)
    assert wrong == gains != []


def test_a_giver_takes_nothing_back_that_its_receiver_may_claim() -> None:
    lineage = founded()
    lineage.changed(B, THIRD, 1.0, lambda _arc: C)
    _, wrong = lineage.changed(B, RIGHT, 2.0)
    assert len(wrong) == 1


def test_what_a_removed_incarnation_believes_counts_no_more() -> None:
    lineage = founded()
    lineage.gone(B)
    assert lineage.changed(B, WHOLE_LINE, 1.0) == ([], [])
    assert lineage.holder_of(FIRST).holder == A


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 63), st.integers(0, 63)), max_size=12))
def test_the_pieces_tile_the_line_whatever_is_claimed(changes: list[tuple[int, int, int]]) -> None:
    lineage = Lineage()
    holders = [A, B, C, Holder(3, b"3" * 16)]
    for at, (slot, one, other) in enumerate(changes):
        low, high = sorted((one, other))
        arc = Arc(Location.from_number(low << 154), Location.from_number(((high + 1) << 154) - 1))
        lineage.changed(holders[slot], arc, float(at))
        assert lineage.holder_of(arc.first).holder == holders[slot]
        assert tiling_problems([("piece", piece.arc) for piece in lineage.pieces]) == []


def test_even_arcs_tile_and_gaps_and_overlaps_are_named() -> None:
    arcs = [(f"n{index}", arc) for index, arc in enumerate(arcs_between(even_right_bounds(4)))]
    assert tiling_problems(arcs) == []
    assert tiling_problems(list(reversed(arcs))) == []
    assert "nobody owns" in tiling_problems(arcs[:2] + arcs[3:])[0]
    assert "nobody owns" in tiling_problems(arcs[:3])[0]
    assert "another's" in tiling_problems([*arcs, ("twice", arcs[1][1])])[0]
    assert len(tiling_problems([])) == 1
