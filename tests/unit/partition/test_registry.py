"""If this fails, an algorithm cannot be had by its name, or another's package cannot bring one."""

from __future__ import annotations

from importlib import metadata

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.partition import camera_frame
from scenefold.partition.registry import BUILT_IN, ENTRY_POINTS, load_algorithm
from scenefold.partition.rules import Measured

FRAME = camera_frame([0, 0, 3], [0, 0, -1], [0, 1, 0])
BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


@pytest.mark.parametrize("name", sorted(BUILT_IN))
@pytest.mark.parametrize("nodes", [1, 2, 3, 16, 127])
def test_an_algorithm_begins_and_goes_on(name, nodes):
    algorithm, hits = load_algorithm(name), np.random.default_rng(1).normal(0, 0.3, (800, 3)).clip(-1, 1)
    partition = algorithm.first(Measured(np.zeros(nodes), np.zeros((0, 3)), None, BOX, np.zeros((0, 2, 3))), nodes, FRAME)
    assert (partition.nodes, partition.epoch) == (nodes, 1)
    loads = np.bincount(partition.owner(hits), minlength=nodes).astype(float)
    after = algorithm.rule(partition, Measured(loads, hits, None, BOX, np.zeros((0, 2, 3))), 0.2)
    assert (after.nodes, after.family) == (nodes, partition.family)


def test_an_installed_package_brings_its_own(monkeypatch):
    installed = metadata.EntryPoints(
        [
            metadata.EntryPoint("mine", "scenefold.partition.registry:BUILT_IN", ENTRY_POINTS),
            metadata.EntryPoint("sectors", "unit.partition.test_registry:SECTORS", ENTRY_POINTS),
        ]
    )
    monkeypatch.setattr(metadata, "entry_points", installed.select)
    assert load_algorithm("sectors") == SECTORS
    with pytest.raises(LocalFault, match="no Algorithm"):
        load_algorithm("mine")
    with pytest.raises(LocalFault, match="hexagons") as raised:
        load_algorithm("hexagons")
    assert "sectors" in str(raised.value.remedy)


SECTORS = BUILT_IN["radial"]
