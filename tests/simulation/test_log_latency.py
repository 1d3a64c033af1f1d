"""If this fails, a decision takes more packets, or more turns of waiting, than its chain has; or the measuring is broken."""

from __future__ import annotations

import pytest

from scenefold.simulation.log_latency import measure


@pytest.mark.parametrize("participants", [3, 5])
def test_a_decision_is_one_way_out_and_home(participants: int) -> None:
    found = measure(participants, 4)
    assert found["packets_per_commit"] == 3 * (participants - 1), "votes, out and home, and the news"
    assert found["violations"] == []
    # The first of the participants is asked, and answers. What follows its own last change an owner need not look for.
    assert found["p50_ms"] == pytest.approx(4)
    assert found["p50_ms"] <= found["p99_ms"] <= 3 * found["p50_ms"]
    assert found["commits_per_s"] == pytest.approx(250, rel=0.5)


def test_those_who_ask_at_once_stand_in_line() -> None:
    """Nobody is refused, and nobody else is asked: so no two of them hold each other up."""
    found = measure(3, 12, clients=4)
    assert found["packets_per_commit"] == 3 * 2
    assert found["violations"] == []
