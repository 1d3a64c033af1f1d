"""If this fails, nodes come to two histories of one log, lose what they have acknowledged, or never come to an end.

The seeds here are a smoke test. One that fails is printed, and fails again: `python -m unit.peer.logs.storm SEED 1`.
"""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.consensus import Outcome
from unit.consensus.laws import Broken
from unit.peer.logs.storm import SIZES, Storm

SEEDS = 36
EACH = 12


@pytest.mark.parametrize("first", range(0, SEEDS, EACH))
def test_anything_at_any_time(first: int) -> None:
    counts: Counter[str] = Counter()
    for seed in range(first, first + EACH):
        storm = Storm(seed)
        try:
            storm.run()
        except (AssertionError, Broken) as broken:
            raise AssertionError(f"seed {seed}: {broken}") from broken
        counts += storm.counts
    assert len(SIZES) <= EACH, "each size has its turn"
    assert counts["decided"] > 20 * EACH, counts
    for what in ("crash", "crash_at", "restart", "part", "deafen", "heal", "fill", *Outcome.__members__):
        assert counts[what] > 0, f"{what} never happened: {counts}"
