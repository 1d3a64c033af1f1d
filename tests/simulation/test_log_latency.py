"""If this fails, a decision takes more packets, or more turns of waiting, than its chain has; or the measuring is broken."""

from __future__ import annotations

import pytest

from scenefold.simulation.log_latency import measure


@pytest.mark.parametrize("participants", [3, 5])
def test_a_decision_is_two_ways_out_and_home_along_the_chain(participants: int) -> None:
    found = measure(participants, 4)
    others = participants - 1
    assert found["packets_per_commit"] == 5 * others, "promises and votes, out and home, and the news"
    assert found["violations"] == []
    # Whoever is asked stands in the middle of the line. Beyond that an owner looks for the newest header, and asks.
    assert found["p50_ms"] == pytest.approx(2 * others + 4)
    assert found["p50_ms"] <= found["p99_ms"] <= 2 * found["p50_ms"]
