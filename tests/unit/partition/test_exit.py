"""If this fails, a ray is handed to the wrong node, or to one too late or too early, and is traced for nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

from scenefold.partition import Partition, camera_frame, even_bounds
from scenefold.partition.boxes import Cut
from unit.partition.cells import directions, partitions, points

ORDINARY = ("scattered", "collinear", "coplanar", "wedges", "slabs", "boxes", "power scattered", "power coplanar")


@given(partitions(ORDINARY))
def test_a_ray_stays_until_its_exit_and_is_the_next_nodes_behind_it(case):
    partition, rng = case
    origins = points(partition, rng)
    ways = directions(rng, len(origins))
    start = partition.owner(origins)
    t_exit, target = partition.exit(origins, ways, 0.0, start)
    assert ((target == -1) == np.isinf(t_exit)).all()
    assert (target != start).all()
    assert (t_exit >= 0.0).all()
    # Much farther away than the cells are wide, squared distances have no digits left to tell them apart.
    leaves = t_exit < 30.0
    reach = np.minimum(t_exit, 30.0)
    for share in (0.3, 0.999):
        assert (partition.owner(origins + (share * reach)[:, None] * ways) == start).all()
    beyond = origins + (reach + 1e-7)[:, None] * ways
    after = partition.owner(beyond[leaves])
    assert (after != start[leaves]).all()
    # The next node owns the point behind the exit, unless its cell is left again within a hair.
    wrong = after != target[leaves]
    assert wrong.sum() <= 0.02 * len(wrong)


@given(partitions())
def test_walking_from_cell_to_cell_ends_and_never_comes_back(case):
    partition, rng = case
    origins = points(partition, rng, 40)
    ways = directions(rng, len(origins))
    node, t = partition.owner(origins, ways), np.zeros(len(origins))
    for _ in range(2 * partition.nodes + 2):
        t_next, target = partition.exit(origins, ways, t, node)
        assert (t_next >= t).all()
        flies = np.isfinite(t_next)
        if not flies.any():
            break
        t = np.where(flies, t_next, t)
        node = np.where(flies, target, node).astype(np.int32)
    else:
        pytest.fail("a ray wanders from cell to cell for ever")


@given(partitions())
def test_exits_do_not_depend_on_the_batch(case):
    partition, rng = case
    origins = points(partition, rng, 60)
    ways, nodes = directions(rng, 60), rng.integers(0, partition.nodes, 60)
    t_exit, target = partition.exit(origins, ways, 0.25, nodes)
    for i in (0, 17, 59):
        alone = partition.exit(origins[i : i + 1], ways[i : i + 1], [0.25], nodes[i : i + 1])
        assert (alone[0][0], alone[1][0]) == (t_exit[i], target[i])


def test_one_cell_is_never_left():
    for partition in (Partition.voronoi([[1, 2, 3]]), Partition.wedges(camera_frame([0, 0, 0], [1, 0, 0], [0, 0, 1]), [])):
        t_exit, target = partition.exit(np.zeros((5, 3)), directions(np.random.default_rng(1), 5), 3.0, 0)
        assert np.isinf(t_exit).all()
        assert (target == -1).all()


def test_a_ray_that_is_outside_already_leaves_now():
    partition = Partition.voronoi([[0, 0, 0], [2, 0, 0], [4, 0, 0]])
    t_exit, target = partition.exit([[0, 0, 0]] * 3, [[1, 0, 0]] * 3, [0.0, 1.5, 3.5], 0)
    assert t_exit.tolist() == [1.0, 1.5, 3.5]
    assert target.tolist() == [1, 1, 2]


def test_through_an_edge_into_the_cell_behind_it():
    grid = Partition.voronoi([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert [x.tolist() for x in grid.exit([[0, 0, 0]], [[1, 1, 0]], 0.0, 0)] == [[0.5], [3]]
    frame = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])
    partition = Partition.wedges(frame, even_bounds(8))
    start = partition.kernel_data()[1] * 0.75 + partition.kernel_data()[2] * 0.25
    t_exit, target = partition.exit([start], [-start], 0.0, 0)
    assert (t_exit.tolist(), target.tolist()) == ([1.0], [4])


@pytest.mark.parametrize("node", [0, 1])
def test_two_wedges_are_two_half_spaces(node):
    partition = Partition.wedges(camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0]), [0.5])
    side = 1.0 - 2.0 * node  # node 0 is to the right of a camera that looks along -z
    assert partition.owner([[side, 3.0, 2.0], [side, -3.0, -2.0]]).tolist() == [node, node]
    t_exit, target = partition.exit([[side, 3.0, 2.0]] * 2, [[-side, 1.0, 0.0], [0.0, 1.0, 0.0]], 0.0, node)
    assert t_exit.tolist() == [1.0, np.inf]
    assert target.tolist() == [1 - node, -1]


def test_an_empty_cell_is_left_at_once_for_its_twin():
    partition = Partition.voronoi([[0, 0, 0], [0, 0, 0], [2, 0, 0]])
    t_exit, target = partition.exit([[0, 0, 0]], [[1, 0, 0]], 0.25, 1)
    assert (t_exit.tolist(), target.tolist()) == ([0.25], [0])


def test_slabs_boxes_and_power_cells_are_left_through_their_planes():
    across = Partition.slabs(camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0]), [1.0, 1.0, 2.0])
    t_exit, target = across.exit([[0, 0, 0], [0, 0, -4], [0, 0, -1.5]], [[1, 0, -1], [0, 0, 2], [1, 0, 0]], 0.0, [0, 3, 2])
    assert (t_exit.tolist(), target.tolist()) == ([1.0, 1.0, np.inf], [2, 2, -1])
    assert across.exit([[0, 0, -1]], [[0, 0, -1]], 0.5, 1)[1].tolist() == [2]
    crossed = Partition.boxes([Cut(0, 0.0, 2), Cut(1, 0.0, 1), Cut(1, 1.0, 1)])
    t_exit, target = crossed.exit([[-1, -1, 0], [-1, -2, 0], [2, 2, 0]], [[1, 1, 0], [1, 1, 0], [-1, -1, 1]], 0.0, [0, 0, 3])
    assert (t_exit.tolist(), target.tolist()) == ([1.0, 1.0, 1.0], [2, 2, 2])
    lifted = Partition.power([[1, 0, 0], [-1, 0, 0]], [0.0, 2.0])
    assert [x.tolist() for x in lifted.exit([[-1, 0, 0]], [[1, 0, 0]], 0.0, 1)] == [[1.5], [0]]
