"""If this fails, there are two histories of one log, or nodes that never come to an end.

The seeds here are a smoke test; `Soup(seed).run()` takes any number, and a seed that fails, fails again.
"""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.consensus import Outcome
from unit.consensus.soup import Soup

SEEDS = 80


def test_41_anything_at_any_time() -> None:
    """The laws hold throughout; after two quiet minutes all have one log, and a fresh request gets through."""
    counts: Counter[str] = Counter()
    for seed in range(SEEDS):
        soup = Soup(seed)
        try:
            soup.run()
        except AssertionError as broken:
            raise AssertionError(f"seed {seed}: {broken}") from broken
        counts += soup.counts
        counts["decided"] += len(soup.world.laws.decided)
        counts.update(reply.outcome.name for node in soup.world.nodes.values() for reply in node.replies)
    assert counts["decided"] > 2 * SEEDS
    for what in ("crash", "crash_soon", "part", "deafen", "fill", "wipe", "replay", "change_members", *Outcome.__members__):
        assert counts[what] > 0, f"{what} never happened"


@pytest.mark.parametrize("seed", [904])
def test_seeds_that_failed_once(seed: int) -> None:
    """904: a node gave up what it had begun, and waited for nothing any more; nobody else knew of it."""
    Soup(seed).run()
