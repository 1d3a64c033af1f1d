"""If this fails, a cluster under faults breaks a law: the story says which, and the command at its end shows it again."""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.simulation.faults import KINDS, Kind
from simulation.runs import fail_with_stories, run_seeds

pytestmark = pytest.mark.timeout(600)
"""A storm ends by its virtual time. What this machine does besides may only make it slow."""

SMOKE = range(12)


@pytest.mark.slow
def test_seeds_hold() -> None:
    results = run_seeds(SMOKE)
    fail_with_stories(results)
    assert {result.order.seed: result.shortage for result in results if result.shortage} == {}, "runs that tested too little"
    happened = Counter[str]()
    for result in results:
        happened.update(result.faults)
    expected = {kind.value for kind in Kind if not (KINDS[kind].of_copies or KINDS[kind].of_clients)}
    assert expected - set(happened) == set(), "kinds of faults that never took effect"


@pytest.mark.slow
@pytest.mark.parametrize("workload", ["data", "members", "keys"])
def test_other_workloads_hold(workload: str) -> None:
    fail_with_stories(run_seeds(range(1_000, 1_003), workload=workload))


@pytest.mark.slow
def test_storms_over_spaces_with_copies_hold() -> None:
    fail_with_stories(run_seeds(range(3), copies=True))


def test_three_nodes_hold() -> None:
    fail_with_stories(run_seeds(range(2), nodes=3))
