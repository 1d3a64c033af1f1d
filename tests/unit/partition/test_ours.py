"""If this fails, our own cells do not share the work, or a poor sample breaks them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Family, Partition, ours, rules
from scenefold.partition.power_fit import fit_weights
from scenefold.partition.running_sample import EMPTY, extended, rays_of_round
from unit.partition.cells import SEEDS, SHAPES, centroids

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])
NOTHING = np.zeros((0, 2, 3))
FEW = st.sampled_from([1, 2, 3, 5, 16, 64, 127])


def room(rng: np.random.Generator, count: int) -> np.ndarray:
    """Hits of a room: most on its floor and one wall, exactly in their planes, and a thing in it."""
    places = rng.uniform(-1, 1, (count, 3))
    places[: count // 2, 2] = -1.0
    places[count // 2 : 3 * count // 4, 0] = -1.0
    places[3 * count // 4 :] = rng.normal([0.3, 0.2, -0.5], 0.1, (count - 3 * count // 4, 3))
    return places


def measured(hits: np.ndarray, geometry: np.ndarray = NOTHING, weights: np.ndarray | None = None) -> rules.Measured:
    return rules.Measured(np.zeros(0), hits, weights, BOX, geometry)


def worst(partition: Partition, hits: np.ndarray) -> float:
    return np.bincount(partition.owner(hits), minlength=partition.nodes).max() * partition.nodes / len(hits)


@pytest.mark.parametrize("nodes", [1, 2, 3, 5, 16, 64, 127])
@pytest.mark.parametrize(("first", "again"), [(ours.first_power, ours.power), (ours.first_kd, ours.kd)])
def test_cells_share_the_sample_and_keep_still(first, again, nodes):
    hits = room(np.random.default_rng(nodes), 8000)
    partition = first(measured(hits), nodes, epoch=3)
    assert (partition.nodes, partition.epoch) == (nodes, 3)
    assert worst(partition, hits) < 1.05
    assert again(partition, measured(hits), 1.0) == partition or nodes == 1
    more = np.concatenate([hits, room(np.random.default_rng(nodes + 1), 8000)])
    after = again(partition, measured(more), 0.0)
    assert worst(after, more) <= worst(partition, more)
    assert worst(after, more) < 1.1
    if again is ours.power:
        assert (after.kernel_data()[:, :3] == partition.kernel_data()[:, :3]).all()


@given(FEW, SEEDS, st.sampled_from(SHAPES))
@settings(max_examples=12)
def test_power_cells_of_any_centroids_never_get_worse(nodes, seed, shape):
    rng = np.random.default_rng(seed)
    hits = room(rng, 600)
    partition = Partition.power(centroids(shape, nodes, rng), rng.uniform(0, 0.1, nodes))
    after = ours.power(partition, measured(hits), 0.0)
    assert worst(after, hits) <= worst(partition, hits)
    if shape == "scattered" and nodes <= 16:
        assert worst(after, hits) < 1.2


@given(FEW, SEEDS)
@settings(max_examples=12)
def test_boxes_never_get_worse(nodes, seed):
    rng = np.random.default_rng(seed)
    first, second = room(rng, 900), rng.uniform(-2, 2, (900, 3))
    partition = ours.first_kd(measured(first), nodes)
    after = ours.kd(partition, measured(second, np.stack([second, second + 0.1], axis=1)), 0.0)
    assert worst(after, second) <= worst(partition, second)
    assert ours.kd(partition, measured(second), 0.5).family == Family.BOXES


@pytest.mark.parametrize("hits", [np.zeros((0, 3)), np.zeros((1, 3)), np.zeros((300, 3)), np.tile(np.eye(3), (50, 1))])
@pytest.mark.parametrize("nodes", [1, 2, 5, 127])
def test_poor_samples_still_make_cells(hits, nodes):
    for first, again in ((ours.first_power, ours.power), (ours.first_kd, ours.kd)):
        partition = first(measured(hits), nodes)
        assert partition.nodes == nodes
        assert again(partition, measured(hits), 0.0).nodes == nodes
        assert again(partition, measured(np.zeros((0, 3))), 0.0) == partition


def test_weights_of_hits_count():
    hits = np.array([[-0.5, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.6, 0, 0]]).repeat(50, axis=0) + np.linspace(0, 0.01, 200)[:, None]
    heavy = np.where(hits[:, 0] < 0.0, 3.0, 1.0)
    for first in (ours.first_power, ours.first_kd):
        owners = first(measured(hits, weights=heavy), 2).owner(hits)
        loads = np.bincount(owners, heavy)
        assert loads.max() == pytest.approx(loads.min())


def test_a_cut_avoids_what_many_hits_lie_on_and_what_it_would_cut():
    rng = np.random.default_rng(1)
    flat = rng.uniform(-1, 1, (4000, 3)) * [1.0, 1.0, 1e-4]
    cuts = ours.first_kd(measured(flat), 16).numbers.reshape(-1, 3)
    assert 2.0 not in cuts[:, 0]
    even = rng.uniform(-1, 1, (4000, 3))
    half = np.array([0.5, 0, 0.5])
    beams = np.stack([even - half, even + half], axis=1)
    assert ours.first_kd(measured(even, beams), 2).numbers[0] == 1.0


def test_soft_shares_and_their_derivative():
    from scenefold.partition.power_fit_kernels import shared

    rng = np.random.default_rng(4)
    points, table, weights = rng.normal(0, 1, (50, 3)), rng.normal(0, 1, (5, 3)), rng.normal(0, 0.3, 5)
    shares, masses, bend, dual = np.full(50, 0.02), np.empty(5), np.empty((5, 5)), []
    shared(points, shares, table, weights, 0.2, masses, bend)
    for node in range(5):
        moved, other = weights.copy(), np.empty(5)
        moved[node] += 1e-6
        dual = [shared(points, shares, table, w, 0.2, other, np.zeros((0, 0))) for w in (weights, moved)]
        assert (dual[1] - dual[0]) / 1e-6 == pytest.approx(0.2 - masses[node], abs=1e-4)
        assert (other - masses) / 1e-6 == pytest.approx(bend[node], abs=1e-4)
    assert masses.sum() == pytest.approx(1.0)


def test_a_running_sample_is_even_over_rounds():
    sample, rng = EMPTY, np.random.default_rng(5)
    for number in range(12):
        hits = np.column_stack([np.full(5000, float(number)), rng.uniform(0, 1, (5000, 2))])
        sample = extended(sample, hits, seed=number, kept=6000)
    assert sample.points.shape == (6000, 3)
    assert (np.diff(sample.draws) >= 0).all()
    assert np.abs(np.bincount(sample.points[:, 0].astype(int)) - 500).max() < 120
    assert len(extended(EMPTY, np.zeros((0, 3)), 1, 10).points) == 0
    assert [rays_of_round(number, 20_000) for number in range(5)] == [4096, 8192, 16384, 20_000, 20_000]
    assert rays_of_round(10**6, 20_000) == 20_000


def test_what_cannot_be_is_said():
    ring = Partition.voronoi(np.eye(3))
    with pytest.raises(LocalFault, match="power"):
        ours.power(ring, measured(BOX), 0.0)
    with pytest.raises(LocalFault, match="k-d"):
        ours.kd(ring, measured(BOX), 0.0)
    with pytest.raises(LocalFault, match="finite"):
        extended(EMPTY, [[np.nan, 0, 0]], 1, 10)
    with pytest.raises(LocalFault, match="weight"):
        fit_weights(np.eye(3), np.zeros(2), BOX, np.ones(2))
