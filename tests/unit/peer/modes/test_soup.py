"""If this fails, somebody edits while somebody renders. A seed that fails, fails again: `Soup(seed).run()`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from unit.peer.modes.mutants import BY_PLAN, IN_THE_SOUP, Mutant
from unit.peer.modes.plans import PLANS
from unit.peer.modes.soup import Soup, found_after
from unit.peer.modes.village import Broken, Village

SEEDS = 40


def test_41_leases_and_active_modes_never_meet() -> None:
    """I7, whatever happens; and enough happens."""
    counts: Counter[str] = Counter()
    for seed in range(SEEDS):
        soup = Soup(seed)
        soup.run()
        counts += soup.counts
    assert min(counts["active"], counts["leased"]) > 50 * SEEDS
    for what in ("borrow", "give_back", "begin_anew", "crash", "decide", "learn", "release", "show_votes", "hear"):
        assert counts[what] > 0, f"{what} never happened"


@pytest.mark.parametrize("plan", PLANS, ids=lambda plan: plan.__name__)
def test_what_chance_seldom_hits(plan: Callable[[], Village]) -> None:
    """Scenarios 28 to 30: nothing of it lets the two meet, and the switch is active in the end."""
    made = plan()
    if made.positions[2].chosen is not None:
        assert made.acting() > 0


@pytest.mark.parametrize("mutant", IN_THE_SOUP, ids=lambda mutant: mutant.__name__)
def test_42_the_soup_misses_each_rule(mutant: Mutant, monkeypatch: pytest.MonkeyPatch) -> None:
    mutant(monkeypatch)
    assert found_after(IN_THE_SOUP[mutant]) is not None


@pytest.mark.parametrize("mutant", BY_PLAN, ids=lambda mutant: mutant.__name__)
def test_42_a_plan_misses_each_rule(mutant: Mutant, monkeypatch: pytest.MonkeyPatch) -> None:
    mutant(monkeypatch)
    with pytest.raises(Broken):
        BY_PLAN[mutant]()
