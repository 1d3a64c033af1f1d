"""If this fails, a safeguard can break and the simulation does not notice: there is a hole in the simulation, or in the mutant."""

from __future__ import annotations

import pytest

from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run

SEEDS: dict[str, tuple[int, ...]] = {
    "durable before ack": (0, 1),
    "durable before release": (0, 1, 2),
    "indirect probe": (7, 1, 3, 9),
    "last copy": (0, 1, 2, 3, 5, 6, 8),
    "left fence": (0, 1),
    "owner lease": (0, 4, 9),
    "settling time": (0, 1),
    "version check": (0, 1),
}
"""Tried in this order: the first is known to find it now, the others when a change of the product has moved everything a little."""


def test_every_mutant_has_its_seeds() -> None:
    assert set(SEEDS) == set(MUTANTS)


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_mutant_is_found(name: str) -> None:
    assert any(run(Order(seed, mutant=name)).violations for seed in SEEDS[name])
