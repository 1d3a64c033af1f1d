"""If this fails, the judge of copies excuses too much, or too little, behind a handover."""

from __future__ import annotations

from scenefold.base.location import Arc, Location
from scenefold.simulation.passed import LATELY_S, Passed


def test_whose_a_place_was_counts_for_a_moment_and_there_alone() -> None:
    now = 10.0
    passed = Passed(lambda: now)
    first, last = Location.from_number(100), Location.from_number(200)
    passed.passes(Arc(first, last), 3)
    assert passed.owners_lately(Location.from_number(150)) == {3}
    assert passed.owners_lately(Location.from_number(201)) == set()
    now += LATELY_S
    passed.passes(Arc(first, last), 4)
    assert passed.owners_lately(first) == {3, 4}
    now += 0.001
    assert passed.owners_lately(first) == {4}
