"""If this fails, a safeguard can break and the simulation does not notice: there is a hole in the simulation, or in the mutant."""

from __future__ import annotations

import pytest

from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run

SEEDS: dict[str, tuple[int, ...]] = {
    "version check": (0, 1),
    "durable before ack": (0, 1),
}
"""Seeds that are known to find each, the first of them mostly alone; how many it takes from 0 on is in docs/benchmarks.md."""


def test_every_mutant_has_its_seeds() -> None:
    assert set(SEEDS) == set(MUTANTS)


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_mutant_is_found(name: str) -> None:
    assert any(run(Order(seed, mutant=name)).violations for seed in SEEDS[name])
