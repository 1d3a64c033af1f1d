"""If this fails, a pool makes a wrong image in bad weather, hangs, holds more than it may, or leaves something of a render on a node."""

from __future__ import annotations

import pytest

from scenefold.simulation.faults import KINDS, Kind
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run
from simulation.runs import fail_with_stories, run_seeds

pytestmark = pytest.mark.timeout(600)
"""A storm ends by its virtual time. What this machine does besides may only make it slow."""

SEEDS = (11,)
"""In it a short storm hits renders in all these ways."""


def test_seeds_hold_and_the_weather_hits_renders() -> None:
    results = run_seeds(SEEDS, workload="renders", storm_s=20.0)
    fail_with_stories(results)
    assert {result.order.seed: result.shortage for result in results if result.shortage} == {}, "runs that tested too little"
    found = [result.renders for result in results if result.renders is not None]
    assert len(found) == len(results)
    for name in ("interrupted", "begun_anew", "attempts_raised", "nodes_lost", "passes_again", "cells_moved"):
        assert any(getattr(renders, name) for renders in found), f"no {name.replace('_', ' ')} in any seed"


@pytest.mark.long
def test_nodes_that_die_over_packets_of_renders() -> None:
    result = run(Order(3, workload="renders", storm_s=20.0, kinds=(Kind.RESET, Kind.KILL_IN_RENDER)))
    fail_with_stories([result])
    assert result.faults[Kind.KILL_IN_RENDER.value] and result.renders is not None and result.renders.images


@pytest.mark.long
def test_packets_of_renders_are_sent_again() -> None:
    """All that waits for a node leaves in one of them, so there are few, and few of these are lost."""
    results = [run(Order(seed, workload="renders", storm_s=20.0, kinds=(Kind.LOSS, Kind.SLOW_NODE, Kind.RESET))) for seed in range(3)]
    fail_with_stories(results)
    assert sum(result.renders.packets_resent for result in results if result.renders is not None)


def test_other_workloads_have_none_of_that() -> None:
    of_renders = {kind for kind in Kind if KINDS[kind].of_renders}
    assert of_renders == {Kind.KILL_IN_RENDER}
    for seed in range(40):
        drawn = {fault.kind for workload in ("all", "logs") for fault in Order(seed, workload=workload).schedule}  # type: ignore[arg-type]
        assert not drawn & of_renders
