"""If this fails, a node misses geometry of its cell and rays fly through walls, or it holds far too much."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition, camera_frame, even_bounds
from unit.partition.cells import directions, partitions, points


def inside(low: np.ndarray, high: np.ndarray, rng: np.random.Generator, count: int) -> np.ndarray:
    """Points of boxes, corners and faces among them: f64[count, m, 3]."""
    shares = np.clip(rng.uniform(-0.5, 1.5, (count, *low.shape)), 0.0, 1.0)
    return np.clip(low + (high - low) * shares, low, high)


@given(partitions(), st.sampled_from([0.0, 1e-3, 0.2]), st.sampled_from([0.0, 1e-6, 0.05, 1.0]))
def test_a_node_is_told_of_every_box_that_its_grown_cell_meets(case, dilation, size):
    partition, rng = case
    low = points(partition, rng, 60)
    high = low + size * rng.uniform(0, 1, low.shape)
    mask = partition.overlaps(low, high, dilation)
    assert mask.shape == (partition.nodes, len(low))
    assert mask.any(axis=0).all()
    for sample in inside(low, high, rng, 60):
        near = sample + dilation * directions(rng, len(low)) * rng.uniform(0, 1, (len(low), 1)) ** 0.2
        assert mask[partition.owner(near), np.arange(len(low))].all()


@given(partitions(("scattered", "coplanar", "grid", "even wedges", "slabs", "boxes")))
@settings(max_examples=30)
def test_hardly_more_than_what_a_cell_meets_is_told(case):
    partition, rng = case
    low = points(partition, rng, 60)
    high = low + 0.1
    told = partition.overlaps(low, high, 0.0)
    met = np.zeros_like(told)
    for sample in inside(low - 0.01, high + 0.01, rng, 1500):
        met[partition.owner(sample), np.arange(len(low))] = True
    assert (told & ~met).sum() <= 0.05 * met.sum() + 2


def test_a_box_opposite_of_a_thin_wedge_is_not_its():
    partition = Partition.wedges(camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0]), even_bounds(64))
    data = partition.kernel_data()
    opposite = -(data[1] + 0.05 * data[2])
    assert not partition.overlaps([opposite - 0.2], [opposite + 0.2], 0.1)[0, 0]


def test_boxes_on_the_hull_belong_to_both():
    partition = Partition.voronoi([[-1, 0, 0], [1, 0, 0]])
    low, high = np.array([[0.0, 0, 0], [0.1, 0, 0], [-1, 0, 0]]), np.array([[1.0, 1, 1], [1, 1, 1], [-0.2, 1, 1]])
    assert partition.overlaps(low, high, 0.0).tolist() == [[True, False, True], [True, True, False]]
    assert partition.overlaps(low, high, 0.15).tolist() == [[True, True, True], [True, True, False]]


@pytest.mark.parametrize("dilation", [-1.0, np.nan, np.inf])
def test_a_senseless_dilation_is_refused(dilation):
    with pytest.raises(LocalFault):
        Partition.voronoi([[0, 0, 0]]).overlaps([[0, 0, 0]], [[1, 1, 1]], dilation)


def test_boxes_inside_out_are_refused():
    with pytest.raises(LocalFault):
        Partition.voronoi([[0, 0, 0]]).overlaps([[0, 2, 0]], [[1, 1, 1]], 0.0)


def test_a_node_with_an_empty_cell_need_hold_hardly_anything():
    hidden = Partition.power([[0, 0, 0], [0, 0, 0], [3, 0, 0]], [0.0, 1.0, 0.0])
    assert not hidden.overlaps([[-9, -9, -9]], [[9, 9, 9]], 0.1)[0, 0]
    thin = Partition.slabs(camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0]), [1.0, 1.0])
    assert thin.overlaps([[0, 0, -3], [0, 0, -3]], [[1, 1, -2], [1, 1, 0]], 0.1)[1].tolist() == [False, True]
