"""If this fails, cells do not follow the work, or a rule makes what cannot be a partition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Family, Partition, camera_frame, rules
from scenefold.partition.circle import fit_circle, largest_on_circle, largest_on_line, turned
from scenefold.partition.placement import radial
from unit.partition.cells import NODES, SEEDS, SHAPES, centroids, slabs, wedges

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])
FREE = [rules.vivaldi, rules.no_certainty, rules.swarming, rules.no_backtracking, rules.voxelised_swarming]
BOUNDED = [rules.planar, rules.radial, rules.bounded_radial]


def cloud(rng: np.random.Generator, count: int = 3000) -> np.ndarray:
    """Hits: a lump, and some about it."""
    return np.concatenate([rng.normal(rng.uniform(-0.5, 0.5, 3), 0.2, (count // 2, 3)), rng.uniform(-1, 1, (count // 2, 3))])


def measure(partition: Partition, hits: np.ndarray, geometry: np.ndarray | None = None) -> rules.Measured:
    loads = np.bincount(partition.owner(hits), minlength=partition.nodes).astype(float)
    return rules.Measured(loads, hits, None, BOX, np.zeros((0, 2, 3)) if geometry is None else geometry)


def worst(partition: Partition, hits: np.ndarray) -> float:
    return np.bincount(partition.owner(hits), minlength=partition.nodes).max() * partition.nodes / len(hits)


def first(rule: rules.Rule, nodes: int, rng: np.random.Generator) -> Partition:
    return slabs(nodes, rng) if rule is rules.planar else wedges(nodes, rng)


@pytest.mark.parametrize("rule", FREE)
@given(NODES, SEEDS, st.sampled_from(SHAPES))
@settings(max_examples=15)
def test_free_algorithms_make_cells_of_any_centroids(rule, nodes, seed, shape):
    rng = np.random.default_rng(seed)
    partition = Partition.voronoi(centroids(shape, nodes, rng))
    hits = cloud(rng, 300) + partition.kernel_data().mean(axis=0)
    geometry = np.stack([hits - 0.05, hits + 0.05], axis=1)
    for _ in range(3):
        after = rule(partition, measure(partition, hits, geometry), 0.25)
        assert (after.nodes, after.family) == (nodes, Family.VORONOI)
        assert after.epoch - partition.epoch == (after.values != partition.values)
        partition = after
    assert rule(partition, measure(partition, hits, geometry), 1.0) == partition
    idle = measure(partition, hits)._replace(loads=np.zeros(nodes), hits=np.zeros((0, 3)))
    assert rule(partition, idle, 0.0) == partition


@pytest.mark.parametrize("rule", [rules.no_backtracking, rules.swarming, rules.voxelised_swarming, rules.no_certainty])
def test_free_algorithms_find_the_work(rule):
    rng = np.random.default_rng(7)
    hits = rng.normal([0.6, 0.5, 0.4], 0.15, (4000, 3))
    partition = Partition.voronoi(radial(BOX, 8, camera_frame([0, 0, 2], [0, 0, -1], [0, 1, 0])))
    before, best = worst(partition, hits), np.inf
    for _ in range(60):
        partition = rule(partition, measure(partition, hits), 0.5)
        best = min(best, worst(partition, hits))
    assert best < 0.6 * before


@pytest.mark.parametrize("rule", BOUNDED)
@given(NODES, SEEDS, st.sampled_from([0.0, 0.4]))
@settings(max_examples=40)
def test_bounds_share_the_work_and_never_get_worse(rule, nodes, seed, damping):
    rng = np.random.default_rng(seed)
    partition, hits = first(rule, nodes, rng), cloud(rng)
    after = rule(partition, measure(partition, hits), damping)
    assert (after.nodes, after.family) == (nodes, partition.family)
    assert rule(partition, measure(partition, hits), 1.0).numbers == pytest.approx(partition.numbers, abs=1e-6)
    if damping == 0.0:
        crumbs = 3.0 * nodes * len(hits) ** -0.5 if nodes > 9 else 0.1
        assert worst(after, hits) <= worst(partition, hits) + crumbs
    again = rule(after, measure(after, hits), 0.0)
    if rule is not rules.radial:  # which may turn on, a little less each time
        assert rule(again, measure(again, hits), 0.0).numbers == pytest.approx(again.numbers, abs=2e-3)


@pytest.mark.parametrize("rule", BOUNDED)
@pytest.mark.parametrize("hits", [np.zeros((0, 3)), np.zeros((50, 3)), np.tile([[0.3, 0.2, 0.1]], (50, 1))])
def test_bounds_take_poor_histograms(rule, hits):
    for nodes in (1, 2, 3, 127):
        partition = first(rule, nodes, np.random.default_rng(nodes))
        after = rule(partition, measure(partition, hits), 0.0)
        assert len(hits) or after == partition
        assert after.nodes == nodes


def test_slabs_are_fitted_to_what_they_hold():
    hits = cloud(np.random.default_rng(3), 20_000).clip(-1, 1)
    for nodes in (2, 5, 16):
        partition = slabs(nodes, np.random.default_rng(nodes))
        assert worst(rules.planar(partition, measure(partition, hits), 0.0), hits) < 1.05


def test_two_wedges_turn_or_stay():
    hits = np.random.default_rng(3).normal([0.5, 0.1, 0.0], 0.2, (5000, 3))
    partition = Partition.wedges(camera_frame([0, 0, 2], [0, 0, -1], [0, 1, 0]), [0.5])
    assert rules.bounded_radial(partition, measure(partition, hits), 0.0) == partition
    assert worst(partition, hits) > 1.9
    turned_once = rules.radial(partition, measure(partition, hits), 0.0)
    assert worst(turned_once, hits) < 1.01
    half = rules.radial(partition, measure(partition, hits), 0.5)
    assert half.kernel_data()[1] @ partition.kernel_data()[1] > turned_once.kernel_data()[1] @ partition.kernel_data()[1]


@given(st.integers(1, 40), SEEDS)
def test_a_circle_is_fitted_to_equal_shares_and_hardly_turned(nodes, seed):
    rng = np.random.default_rng(seed)
    counts, even = rng.integers(50, 150, 2048), np.arange(1, nodes) / nodes
    turn, bounds = fit_circle(counts, even)
    assert largest_on_circle(counts, turn, bounds) <= counts.sum() / nodes * (1.0 + 2e-2)
    assert abs(turn) < 0.5 if nodes == 2 else abs(turn) < 0.1
    again, _ = fit_circle(turned(counts, turn), bounds)
    assert abs(again) < 1e-2
    assert turned(counts, turn).sum() == pytest.approx(counts.sum())
    assert largest_on_line(counts, even) == pytest.approx(largest_on_circle(counts, 0.0, even))


def test_what_rules_cannot_take_is_said():
    ring = Partition.voronoi(np.eye(3))
    wedge = wedges(3, np.random.default_rng(1))
    for rule in FREE:
        with pytest.raises(LocalFault, match="Voronoi"):
            rule(wedge, measure(wedge, BOX), 0.0)
        for wrong in ([1.0, 2.0], [1.0, -1.0, 0.0], [np.nan, 1, 1]):
            with pytest.raises(LocalFault, match="load"):
                rule(ring, measure(ring, BOX)._replace(loads=np.array(wrong)), 0.0)
        with pytest.raises(LocalFault, match="damping"):
            rule(ring, measure(ring, BOX), 1.5)
    with pytest.raises(LocalFault, match="slabs"):
        rules.planar(ring, measure(ring, BOX), 0.0)
    for rule in (rules.radial, rules.bounded_radial):
        with pytest.raises(LocalFault, match="wedges"):
            rule(ring, measure(ring, BOX), 0.0)
