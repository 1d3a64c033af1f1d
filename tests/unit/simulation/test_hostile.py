"""If this fails, liars in the simulation tell no lies, or the network forgets what to play again, or a lie breaks more than it may."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from scenefold.simulation.faults import Kind
from scenefold.simulation.liar import flipped
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run


@pytest.mark.parametrize("size", [1, 16, 1400])
def test_one_bit_is_turned_over(size: int) -> None:
    dice, data = random.Random(size), bytes(size)
    for _ in range(100):
        assert sum(byte.bit_count() for byte in flipped(data, dice)) == 1


def test_lies_are_told_and_datagrams_played_again_and_nothing_breaks() -> None:
    seen = Counter[str]()
    for seed in range(2):
        outcome = run(Order(seed, kinds=(Kind.LIAR, Kind.REPLAY), storm_s=20.0))
        assert not outcome.violations
        seen.update(outcome.counts)
        seen.update(outcome.faults)
    assert seen["lies"] > 0 and seen["lying node"] > 1 and seen["replayed datagrams"] > 1
