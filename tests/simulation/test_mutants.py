"""If this fails, a safeguard can break and the simulation does not notice: there is a hole in the simulation, or in the mutant."""

from __future__ import annotations

import pytest

from scenefold.simulation import laws
from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import Order
from scenefold.simulation.run import run

SEEDS: dict[str, tuple[str, tuple[int, ...]]] = {
    "durable before ack": (laws.DURABLE, (0, 1)),
    "durable before release": (laws.CARRIED, (7, 8, 0)),
    "indirect probe": (laws.REMOVED_RIGHTLY, (43, 7, 1)),
    "last copy": (laws.CARRIED, (0, 26, 33)),
    "left fence": (laws.ONE_OWNER, (0, 1)),
    "owner lease": (laws.ONE_OWNER, (0, 4, 9)),
    "restored backup": (laws.RIGHT_TO_ANSWER, (2, 5, 7, 8)),
    "settling time": (laws.SETTLED, (0, 1)),
    "version check": (laws.LINEARIZABLE, (0, 1)),
}
"""The law that each breaks, and seeds: the first is known to find it now, the others when a change of the product has moved
everything a little."""


def test_every_mutant_has_its_seeds() -> None:
    assert set(SEEDS) == set(MUTANTS)


@pytest.mark.parametrize("name", sorted(MUTANTS))
def test_a_mutant_is_found(name: str) -> None:
    law, seeds = SEEDS[name]
    assert any(law in {found.law for found in run(Order(seed, mutant=name)).violations} for seed in seeds)
