"""If this fails, a copy of a disk is granted leases for ever, an honest node none, or a lease outlives what is waited for behind a removal.

The seeds here are a smoke test; `Soup(seed).run()` and `Walk(seed).run()` take any number, and a seed that fails, fails again.
"""

from __future__ import annotations

from collections import Counter

import pytest

from unit.peer.lives.lives_mutants import MUTANTS, Mutant
from unit.peer.lives.lives_soup import Soup, found_after
from unit.peer.lives.lives_walk import Walk

SEEDS = 12
WALKS = 300


def test_anything_at_any_time() -> None:
    counts: Counter[str] = Counter()
    for seed in range(SEEDS):
        soup = Soup(seed)
        try:
            soup.run()
        except AssertionError as broken:
            raise AssertionError(f"seed {seed}: {broken}") from broken
        counts += soup.counts
    for what in ("granted", "leased", "refused", "removed", "asked late", "copy", "twins", "put_back", "crash", "part", "change_voters"):
        assert counts[what] > SEEDS // 2, f"{what} hardly ever happened"


def test_any_step_that_may_happen() -> None:
    counts: Counter[str] = Counter()
    for seed in range(WALKS):
        walk = Walk(seed)
        try:
            walk.run()
        except AssertionError as broken:
            raise AssertionError(f"walk {seed}: {broken}") from broken
        counts += walk.judge.counts
    assert counts["granted"] > WALKS // 2 and counts["asked late"] > 0 and counts["refused"] > 0


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.__name__)
def test_every_mutant_is_found(mutant: Mutant, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        assert found_after(MUTANTS[mutant], lambda soup: mutant(patch, soup)) is not None
