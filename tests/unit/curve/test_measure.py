"""If this fails, `scenectl bench curve` has no figures, or wrong ones."""

from __future__ import annotations

import itertools

from scenefold.base.measuring import Rate, Work, measure_in_turns
from scenefold.curve import Curve, curve_works


def test_rates_are_work_by_the_clock() -> None:
    ticks = itertools.count(0.0, 0.5)
    rates = measure_in_turns(curve_works(Curve("hilbert", 3), points=100, boxes=4, limit=8), lambda: next(ticks), rounds=3)
    assert {name: rate.median for name, rate in rates.items()} == {"encode": 200.0, "decode": 200.0, "arcs": 8.0}


def test_works_take_turns_after_one_round_that_does_not_count() -> None:
    done: list[str] = []
    times = iter([0.0, 1.0, 1.0, 2.0, 2.0, 6.0, 6.0, 7.0, 7.0, 9.0, 9.0, 10.0])
    works = [Work(name, 4, lambda name=name: done.append(name)) for name in "ab"]
    rates = measure_in_turns(works, lambda: next(times), rounds=3)
    assert done == ["a", "b"] * 4
    assert rates["a"] == Rate(median=2.0, least=1.0, most=4.0)
