"""If this fails, records that wander pass unseen, or a clock within its tolerance is blamed."""

from __future__ import annotations

from scenefold.simulation.history import Place
from scenefold.simulation.moves import Moves

HERE, THERE = Place(1, 1, b"a" * 20), Place(1, 1, b"b" * 20)


def test_once_in_ten_seconds() -> None:
    moves = Moves()
    assert moves.handed_over([HERE, THERE], 5.0) == []
    assert moves.handed_over([THERE], 15.0) == []
    assert [hurry.place for hurry in moves.handed_over([HERE, THERE], 20.0)] == [THERE]
    assert moves.count == 5


def test_a_clock_may_be_one_percent_fast() -> None:
    moves = Moves()
    moves.handed_over([HERE], 0.0)
    assert moves.handed_over([HERE], 9.905) == []
    assert len(moves.handed_over([HERE], 19.7)) == 1
