"""If this fails, a point has no owner or two, or a ray can come back to a cell that it left (thesis 3.1)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from scenefold.partition import Partition, camera_frame, even_bounds
from scenefold.partition.boxes import Cut
from unit.partition.cells import OTHERS, SEEDS, centroids, cuts, directions, partitions, points, power, slabs, wedges

FRAME = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])


@given(partitions())
def test_every_point_has_one_owner_whatever_the_batch(case):
    partition, rng = case
    places = points(partition, rng)
    owners = partition.owner(places)
    assert owners.dtype == np.int32
    assert owners.min() >= 0
    assert owners.max() < partition.nodes
    order = rng.permutation(len(places))
    assert (partition.owner(places[order]) == owners[order]).all()
    assert (np.concatenate([partition.owner(places[:7]), partition.owner(places[7:])]) == owners).all()


@given(SEEDS)
def test_voronoi_owner_is_the_nearest_centroid(seed):
    rng = np.random.default_rng(seed)
    table = centroids("scattered", 20, rng)
    places = rng.normal(0, 1, (300, 3))
    nearest = ((places[:, None, :] - table) ** 2).sum(axis=2).argmin(axis=1)
    assert (Partition.voronoi(table).owner(places) == nearest).all()


@given(SEEDS)
def test_wedge_owner_is_the_span_of_the_angle(seed):
    rng = np.random.default_rng(seed)
    partition = wedges(int(rng.integers(1, 128)), rng)
    data = partition.kernel_data()
    away = rng.normal(0, 1, (300, 3))
    fractions = np.arctan2(away @ data[2], away @ data[1]) / (2 * np.pi) % 1.0
    bounds = np.concatenate([[0.0], partition.numbers[9:], [1.0]])
    clear = np.abs(fractions[:, None] - bounds).min(axis=1) > 1e-9
    expected = np.searchsorted(bounds, fractions, side="right") - 1
    assert (partition.owner(data[0] + away)[clear] == expected[clear]).all()


@given(SEEDS)
def test_power_owner_has_the_least_power(seed):
    rng = np.random.default_rng(seed)
    partition, places = power("scattered", 20, rng), rng.normal(0, 1, (300, 3))
    table = partition.kernel_data()
    powers = ((places[:, None, :] - table[:, :3]) ** 2).sum(axis=2) - table[:, 3]
    assert (partition.owner(places) == powers.argmin(axis=1)).all()
    alike = Partition.power(table[:, :3], np.full(20, 0.5))
    assert (alike.owner(places) == Partition.voronoi(table[:, :3]).owner(places)).all()


@given(SEEDS)
def test_slab_owner_is_the_slice_of_the_depth(seed):
    rng = np.random.default_rng(seed)
    partition = slabs(int(rng.integers(1, 128)), rng)
    data, places = partition.kernel_data(), rng.normal(0, 1, (300, 3))
    depths, bounds = (places - data[0]) @ data[1], partition.numbers[6:]
    clear = np.abs(depths[:, None] - bounds).min(axis=1, initial=1.0) > 1e-12
    assert (partition.owner(places)[clear] == np.searchsorted(bounds, depths)[clear]).all()


@given(SEEDS)
def test_box_owner_is_the_only_box_around_the_point(seed):
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(1, 128))
    partition, places = Partition.boxes(cuts(nodes, rng)), rng.normal(0, 1, (300, 3))
    boxes = partition.kernel_data()[:nodes]
    inside = ((places[:, None] > boxes[:, :3]) & (places[:, None] <= boxes[:, 3:])).all(axis=2)
    assert (inside.sum(axis=1) == 1).all()
    assert (partition.owner(places) == inside.argmax(axis=1)).all()


@given(partitions(("scattered", "collinear", "coplanar", "grid", "pairs", *OTHERS[:-2])))
def test_cells_are_convex(case):
    partition, rng = case
    here = points(partition, rng, 400)
    owners = partition.owner(here)
    order = np.argsort(owners, kind="stable")
    first, second = order[:-1], order[1:]
    same = owners[first] == owners[second]
    for share in (0.1, 0.5, 0.77):
        between = here[first] * (1 - share) + here[second] * share
        assert (partition.owner(between)[same] == owners[first][same]).all()


@pytest.mark.parametrize("nodes", [1, 2, 3, 4, 8, 127])
def test_the_lowest_node_owns_the_axis_and_hulls_of_wedges(nodes):
    partition = Partition.wedges(FRAME, even_bounds(nodes))
    data = partition.kernel_data()
    assert partition.owner([[0, 0, 0], [0, 0, 5], [0, 0, -5]]).tolist() == [0, 0, 0]
    hulls = data[3:, :1] * data[1] + data[3:, 1:2] * data[2]
    expected = [0, *range(nodes - 1)]
    assert partition.owner(hulls).tolist() == expected


def test_the_lowest_node_owns_hulls_of_voronoi_cells():
    partition = Partition.voronoi([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    assert partition.owner([[0, 0, 7], [-1, 1, 0], [-2, -2, 1], [1, -1, 0]]).tolist() == [0, 1, 1, 0]


def test_coincident_centroids_leave_all_to_the_lowest():
    assert set(Partition.voronoi(np.ones((5, 3))).owner(np.random.default_rng(1).normal(0, 9, (99, 3)))) == {0}


def test_a_camera_ray_is_born_in_the_cell_it_flies_into():
    partition = Partition.wedges(camera_frame([0.1, 0.2, 0.3], [1, 2, 3], [0, 0, 1]), even_bounds(8))
    ways = directions(np.random.default_rng(5), 4000)
    origin = np.tile(partition.kernel_data()[0], (len(ways), 1))
    born = partition.owner(origin, ways)
    assert (born == partition.owner(origin + ways)).all()
    assert np.bincount(born, minlength=8).min() > 400
    t_exit, target = partition.exit(origin, ways, 0.0, born)
    assert np.isinf(t_exit).all()
    assert (target == -1).all()


def test_on_a_hull_the_direction_decides_else_the_lowest_node():
    partition = Partition.voronoi([[1, 0, 0], [-1, 0, 0]])
    origins, ways = np.zeros((3, 3)), [[1, 0, 0], [-1, 0, 0], [0, 1, 0]]
    assert partition.owner(origins, ways).tolist() == [0, 1, 0]


def test_the_lowest_node_owns_hulls_of_slabs_boxes_and_power_cells():
    across = Partition.slabs(FRAME, [1.0, 1.0, 2.0])
    assert across.owner([[0, 0, -1], [5, 5, -2], [0, 0, -1.5], [0, 0, -2.5]]).tolist() == [0, 2, 2, 3]
    assert across.owner([[0, 0, -1]] * 3, [[0, 0, -1], [0, 0, 1], [1, 0, 0]]).tolist() == [2, 0, 0]
    crossed = Partition.boxes([Cut(0, 0.0, 2), Cut(1, 0.0, 1), Cut(1, 0.0, 1)])
    assert crossed.owner([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]).tolist() == [0, 1, 2, 3]
    assert crossed.owner([[0, 0, 0]] * 3, [[1, 1, 0], [-1, 1, 0], [1, 0, 0]]).tolist() == [3, 1, 2]
    lifted = Partition.power([[1, 0, 0], [-1, 0, 0]], [0.0, 2.0])
    assert lifted.owner([[0.5, 7, 0], [0.51, 0, 0], [0.49, 0, 0]]).tolist() == [0, 0, 1]
    assert lifted.owner([[0.5, 7, 0]] * 2, [[1, 0, 0], [-1, 0, 0]]).tolist() == [0, 1]


def test_of_power_cells_on_one_centroid_the_heaviest_owns_all():
    partition = Partition.power(np.ones((4, 3)), [0.0, 1.0, 1.0, -1.0])
    assert set(partition.owner(np.random.default_rng(1).normal(0, 9, (99, 3)))) == {1}
