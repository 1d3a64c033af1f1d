"""If this fails, a node balances with the wrong ones, or leaves the hull of those it balances with."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition, camera_frame
from scenefold.partition.free import within_cell, within_hull
from scenefold.partition.peers import peers, room
from unit.partition.cells import NODES, SEEDS, SHAPES, centroids, power

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def seen_beside(partition: Partition, rng: np.random.Generator, count: int) -> np.ndarray:
    """Pairs of nodes that a short step leads between, somewhere in the box: bool[N, N]."""
    places = rng.uniform(-1.0, 1.0, (count, 3))
    first, second = partition.owner(places), partition.owner(places + rng.normal(0, 1e-4, (count, 3)))
    seen = np.zeros((partition.nodes, partition.nodes), bool)
    seen[first, second] = seen[second, first] = True
    np.fill_diagonal(seen, False)
    return seen


@given(SEEDS)
def test_cells_with_a_border_between_them_are_peers(seed):
    rng = np.random.default_rng(seed)
    for partition in (Partition.voronoi(centroids("scattered", 12, rng)), power("scattered", 12, rng)):
        near = peers(partition, BOX)
        owned = np.bincount(partition.owner(rng.uniform(-1, 1, (2000, 3))), minlength=12) > 0
        seen = seen_beside(partition, rng, 4000)
        assert not (seen & ~near)[np.ix_(owned, owned)].any()


@given(NODES, SEEDS)
def test_peers_of_every_kind_of_centroids(nodes, seed):
    rng = np.random.default_rng(seed)
    for shape in SHAPES:
        partition = Partition.voronoi(centroids(shape, nodes, rng))
        near = peers(partition, BOX + np.round(partition.kernel_data()[0]))
        assert near.shape == (nodes, nodes)
        assert not near.diagonal().any()
        hosts = partition.owner(partition.kernel_data())
        own = hosts == np.arange(nodes)
        assert (near == near.T)[np.ix_(own, own)].all()
        if nodes > 1 and shape != "tight":
            assert near[~own].any(axis=1).all()
            assert near[own].any(axis=1).all() or own.sum() == 1


def test_a_line_a_grid_and_a_ring_have_their_neighbours_alone():
    line = peers(Partition.voronoi([[x, 0, 0] for x in (3, 0, 2, 1)]), BOX)
    assert [np.flatnonzero(row).tolist() for row in line] == [[2], [3], [0, 3], [1, 2]]
    grid = peers(Partition.voronoi([[x, y, 0] for x in range(3) for y in range(3)]), BOX)
    assert np.flatnonzero(grid[4]).tolist() == [1, 3, 5, 7]
    assert grid.sum() == 24
    turns = 2 * np.pi * np.arange(9) / 9
    ring = peers(Partition.voronoi(np.column_stack([np.cos(turns), np.sin(turns), np.zeros(9)])), BOX)
    assert (ring.sum(axis=1) == 2).all()
    assert ring[np.arange(9), (np.arange(9) + 1) % 9].all()


def test_an_empty_cell_sees_its_hosts_peers_and_is_seen_by_nobody():
    near = peers(Partition.voronoi([[0, 0, 0], [1, 0, 0], [0, 0, 0]]), BOX)
    assert near.tolist() == [[False, True, False], [True, False, False], [True, True, False]]
    alone = peers(Partition.voronoi(np.zeros((3, 3))), BOX)
    assert alone.tolist() == [[False] * 3, [True, False, False], [True, False, False]]


def test_only_cells_of_centroids_have_facets():
    with pytest.raises(LocalFault, match="centroids"):
        peers(Partition.slabs(camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0]), [1.0]), BOX)


@given(SEEDS)
def test_the_hull_rule_stops_on_the_hull(seed):
    rng = np.random.default_rng(seed)
    place, around = rng.normal(0, 1, 3), rng.normal(0, 1, (rng.integers(1, 9), 3))
    inside = rng.dirichlet(np.ones(len(around) + 1)) @ np.vstack([place, around])
    assert np.allclose(within_hull(place, inside, around), inside, atol=1e-7)
    target = place + 50.0 * (inside - place)
    stop = within_hull(place, target, around)
    share = ((stop - place) @ (target - place)) / ((target - place) @ (target - place) or 1.0)
    assert -1e-12 <= share <= 1.0
    # Some plane through the place where it stops has the whole hull on one side: no direction of many tells otherwise.
    ways = rng.normal(0, 1, (20_000, 3))
    assert ((np.vstack([place, around]) @ ways.T).max(axis=0) >= stop @ ways.T - 1e-9 * (1 + np.abs(ways).sum(axis=1))).all()


def test_the_hull_rule_on_planes_lines_and_points():
    square = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    assert np.allclose(within_hull(np.zeros(3), np.array([2.0, 2, 0]), square), [0.5, 0.5, 0])
    assert np.allclose(within_hull(np.zeros(3), np.array([0.0, 0, 2]), square), 0)
    assert np.allclose(within_hull(np.zeros(3), np.array([5.0, 0, 0]), np.array([[1.0, 0, 0], [3, 0, 0], [3, 0, 0]])), [3, 0, 0])
    assert np.allclose(within_hull(np.zeros(3), np.array([-5.0, 0, 0]), np.array([[1.0, 0, 0]])), 0)
    assert np.allclose(within_hull(np.zeros(3), np.zeros(3), np.zeros((2, 3))), 0)


@given(SEEDS)
def test_a_cell_is_not_left(seed):
    rng = np.random.default_rng(seed)
    table = centroids("scattered", int(rng.integers(1, 20)), rng)
    partition, corners = Partition.voronoi(table), room(BOX, table)
    for node, place in enumerate(table):
        stop = within_cell(place, place + rng.normal(0, 3, 3), node, table, corners)
        assert partition.owner([place + (1 - 1e-9) * (stop - place)]) == [node]
        assert (stop >= corners[0] - 1e-12).all()
        assert (stop <= corners[1] + 1e-12).all()
