"""If this fails, nodes do not move as the thesis says they do (Algorithms 1, 2 and 4)."""

from __future__ import annotations

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.partition import free
from scenefold.partition.damping import damped, decayed

# Tables 3.1 and 3.2: loads of the peers 2 .. 6, the deviation of each node's own peers, unit vectors from node 1 to them.
LOADS = np.array([2500.0, 3000, 4500, 5000, 3500])
DOUBTS = np.array([1258.0, 1686, 866, 418, 1158])
UNITS = np.array([[0.0068, 0.9999, 0], [0.6626, 0.7490, 0], [0.8400, -0.5426, 0], [0.2362, -0.9717, 0], [-0.9166, -0.3998, 0]])
PLACE = np.array([0.495, 0.428, 0.0])


def test_table_3_1():
    assert free.doubt(LOADS) == pytest.approx(1037, abs=0.5)
    assert (free.doubt(np.array([7.0])), free.doubt(np.zeros(0))) == (0.0, 0.0)


def test_table_3_2():
    weights = LOADS * free.confidence(free.doubt(LOADS), DOUBTS)
    assert weights / weights.sum() == pytest.approx([0.1136, 0.1149, 0.2467, 0.3584, 0.1663], abs=1e-4)
    assert free.pull(PLACE, PLACE + UNITS, weights) == pytest.approx([0.2163, -0.3489, 0.0], abs=1e-4)
    moved = free.vivaldi(PLACE, PLACE + UNITS, weights, 1.0, 0.5)
    assert moved == pytest.approx([0.6032, 0.2535, 0.0], abs=1e-4)
    near = free.vivaldi(PLACE, PLACE + 0.1 * UNITS, weights, 1.0, 0.5)
    assert np.linalg.norm(near - PLACE) < 0.1
    assert np.cross(near - PLACE, moved - PLACE) == pytest.approx([0, 0, 0], abs=1e-12)


def test_certain_nodes_pull_by_halves_and_idle_ones_not_at_all():
    assert free.confidence(0.0, np.array([0.0, 2.0])).tolist() == [0.5, 0.0]
    assert free.pull(np.zeros(3), np.array([[1.0, 0, 0]]), np.zeros(1)).tolist() == [0, 0, 0]
    assert free.pull(np.zeros(3), np.zeros((1, 3)), np.ones(1)).tolist() == [0, 0, 0]


def test_swarming_goes_to_the_heavy_and_back():
    heavy = np.array([[4.0, 0, 0]])
    assert free.swarm(np.zeros(3), 1.0, heavy, np.array([3.0]), back=True) == pytest.approx([1.5, 0, 0])
    assert free.swarm(heavy[0], 3.0, np.zeros((1, 3)), np.array([1.0]), back=True) == pytest.approx([4.5, 0, 0])
    assert free.swarm(heavy[0], 3.0, np.zeros((1, 3)), np.array([1.0]), back=False) == pytest.approx([4, 0, 0])
    assert free.swarm(heavy[0], 0.0, np.zeros((1, 3)), np.array([0.0]), back=True) == pytest.approx([4, 0, 0])
    assert free.swarm(heavy[0], 5.0, np.zeros((0, 3)), np.zeros(0), back=True) == pytest.approx([4, 0, 0])


def test_a_retreat_leads_from_where_most_hits_are():
    tally = np.zeros((4, 1, 1), np.int64)
    tally[:2, 0, 0] = [3, 1]
    low, high = np.zeros(3), np.array([4.0, 1, 1])
    lightly = (0.5 / 3 + 1.5) / (1 / 3 + 1)
    assert free.retreat(2.0, 1.0, low, high, tally) == pytest.approx([lightly + 0.5 * (3.0 - lightly), 0.5, 0.5])
    assert free.retreat(1.0, 1.0, low, high, tally) == pytest.approx([lightly, 0.5, 0.5])
    assert free.retreat(2.0, 1.0, low, high, np.ones_like(tally)) == pytest.approx([2, 0.5, 0.5])
    assert free.retreat(2.0, 1.0, low, high, np.zeros_like(tally)) is None


def test_damping():
    assert damped(np.zeros(2), np.ones(2), 0.25).tolist() == [0.75, 0.75]
    assert decayed(0.2, 0, 1000) == pytest.approx(0.2)
    assert decayed(0.2, 2000, 1000) == pytest.approx(0.8)
    for wrong in (-0.1, 1.1, np.nan):
        with pytest.raises(LocalFault, match="damping"):
            damped(np.zeros(1), np.ones(1), wrong)
    with pytest.raises(LocalFault, match="decay"):
        decayed(0.5, 10, 0)
