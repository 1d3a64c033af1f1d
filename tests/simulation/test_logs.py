"""If this fails, a scene's log breaks a law under faults, or the storms of logs test nothing."""

from __future__ import annotations

import json

import pytest

from scenefold.simulation.outcome import COMMITTED_MIN, Order
from scenefold.simulation.run import run
from simulation.runs import command, fail_with_stories

STORM_S = 20.0


@pytest.mark.parametrize(("seed", "participants"), [(0, 0), (0, 3), (2, 5)])
def test_a_log_holds_whoever_decides_it(seed: int, participants: int) -> None:
    result = run(Order(seed, workload="logs", participants=participants, storm_s=STORM_S))
    fail_with_stories([result])
    assert result.proposals is not None and result.proposals.committed >= COMMITTED_MIN and result.shortage == ""


def test_the_report_says_what_became_of_proposals() -> None:
    done = command("--replay", "3", "--workload", "logs", "--participants", "3", "--seconds", "20", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["committed"] == report["committed_min"] >= COMMITTED_MIN and {"refused", "taken_over"} <= set(report)
    assert "3 participants" in done.stderr
