"""If this fails, nodes come to two histories of one log, lose what they have acknowledged, or never come to an end.

The seeds here are a smoke test. One that fails is printed, and fails again: `python -m unit.peer.logs.storm SEED 1`.
"""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.consensus import Outcome
from unit.consensus.laws import Broken
from unit.peer.logs.storm import SIZES, Storm

SEEDS = 12
EACH = 6


@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.long) for first in range(EACH, SEEDS, EACH))])
def test_anything_at_any_time(first: int) -> None:
    counts: Counter[str] = Counter()
    for seed in range(first, first + EACH):
        storm = Storm(seed)
        try:
            storm.run()
        except (AssertionError, Broken) as broken:
            raise AssertionError(f"seed {seed}: {broken}") from broken
        counts += storm.counts
    assert counts["decided"] > 10 * EACH, counts


def test_nothing_that_can_happen_is_left_out() -> None:
    """Else the seeds above would say little: each has some dozens of these."""
    counts: Counter[str] = Counter()
    for seed in range(2 * len(SIZES)):
        storm = Storm(seed)
        storm.run()
        counts += storm.counts
    for what in ("crash", "crash_at", "restart", "part", "deafen", "heal", "fill", "asked the first", *Outcome.__members__):
        assert counts[what] > 0, f"{what} never happened: {counts}"
