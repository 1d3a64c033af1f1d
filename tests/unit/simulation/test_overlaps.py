"""If this fails, a fault that ends takes another one of its kind along."""

from __future__ import annotations

from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.overlaps import Overlaps


def test_the_worst_of_a_target_is_in_force_until_the_last_ends() -> None:
    weak, strong = (Fault(Kind.CLOCK_RATE, 0.0, 1.0, (1,), amount) for amount in (0.001, -0.009))
    overlaps: Overlaps[int] = Overlaps()
    assert overlaps.worst(1) is None
    assert overlaps.begin(1, strong) and not overlaps.begin(1, weak)
    assert overlaps.worst(1) == -0.009 and overlaps.worst(2) is None
    assert not overlaps.end(1, strong) and overlaps.worst(1) == 0.001
    assert overlaps.end(1, weak) and overlaps.worst(1) is None
