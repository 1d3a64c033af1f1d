"""If this fails, a cluster under faults breaks a law: the story says which, and the command at its end shows it again."""

from __future__ import annotations

import pytest

from scenefold.simulation.faults import KINDS, Kind
from scenefold.simulation.outcome import Result
from simulation.runs import fail_with_stories, run_seeds

pytestmark = pytest.mark.timeout(600)
"""A storm ends by its virtual time. What this machine does besides may only make it slow."""

SMOKE = range(12)
COPIES = 6, 26, 145, 206
"""In these all that befalls copies happens: all kinds of it take effect in two of them at least, as the product is now."""


def check_happened(results: list[Result], kinds: set[Kind]) -> None:
    """Each of these kinds of faults has taken effect somewhere. If one has not, and still does in other seeds, these have to be tried instead."""
    happened = {kind for result in results for kind in result.faults}
    assert {kind.value for kind in kinds} - happened == set(), "kinds of faults that never took effect"


@pytest.mark.slow
def test_seeds_hold() -> None:
    results = run_seeds(SMOKE)
    fail_with_stories(results)
    assert {result.order.seed: result.shortage for result in results if result.shortage} == {}, "runs that tested too little"
    check_happened(results, {kind for kind in Kind if not (KINDS[kind].of_copies or KINDS[kind].of_clients or KINDS[kind].of_renders)})


@pytest.mark.slow
@pytest.mark.parametrize("workload", ["data", "members", "keys"])
def test_other_workloads_hold(workload: str) -> None:
    fail_with_stories(run_seeds(range(1_000, 1_002), workload=workload))


@pytest.mark.slow
def test_storms_over_spaces_with_copies_hold() -> None:
    results = run_seeds(COPIES, copies=True)
    fail_with_stories(results)
    check_happened(results, {kind for kind in Kind if KINDS[kind].of_copies})


def test_three_nodes_hold() -> None:
    fail_with_stories(run_seeds(range(2), nodes=3))
