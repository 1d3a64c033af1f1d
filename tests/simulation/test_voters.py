"""If this fails, a cluster whose log several nodes decide breaks a law under faults: the story says which."""

from __future__ import annotations

import pytest

from scenefold.simulation.faults import Kind
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run
from simulation.runs import fail_with_stories

pytestmark = pytest.mark.timeout(600)


@pytest.mark.slow
@pytest.mark.parametrize("voters", [3, 5])
def test_a_seed_holds_with_several_voters(voters: int) -> None:
    result = run(Order(2, voters=voters, kinds=(Kind.WIPED_DISK, Kind.CRASH, Kind.PARTITION, Kind.ONE_WAY)))
    fail_with_stories([result])
    assert result.faults.get("wiped disk") and not result.shortage and f"--voters {voters}" in result.order.replay


@pytest.mark.slow
def test_of_several_voters_whole_racks_leave_a_majority() -> None:
    result = run(Order(6, voters=3, copies=True, kinds=(Kind.LOST_RACK, Kind.LOST_NODES, Kind.PARTITION)))
    fail_with_stories([result])
    assert result.faults.get("lost rack") and result.faults.get("lost nodes") and not result.shortage
