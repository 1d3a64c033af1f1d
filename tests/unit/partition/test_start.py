"""If this fails, a render starts with cells that are unfair, depend on chance, or do not follow the camera."""

from __future__ import annotations

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition, camera_frame, make_partition
from scenefold.partition.placement import planar, radial, random, van_der_corput

BOX = np.array([[-4.0, -3.0, 0.0], [6.0, 3.0, 2.0]])
CAMERA = {"camera_position": [0, -8, 1], "camera_forward": [0, 1, 0.1], "camera_up": [0, 0, 1]}
FRAME = camera_frame(*CAMERA.values())
COUNTS = [1, 2, 3, 5, 16, 64, 127]


def sample(seed: int = 1, count: int = 6000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    cloud, lump = rng.uniform(BOX[0], BOX[1], (count // 2, 3)), rng.normal([3, 1, 1], 0.3, (count // 2, 3))
    return np.clip(np.concatenate([cloud, lump]), *BOX), rng.uniform(0.5, 2.0, count // 2 * 2)


@pytest.mark.parametrize("nodes", COUNTS)
def test_voronoi_cells_share_the_sample(nodes):
    points, weights = sample()
    partition = make_partition("voronoi", nodes, BOX, **CAMERA, sample_points=points, weights=weights, epoch=3)
    assert (partition.nodes, partition.epoch) == (nodes, 3)
    loads = np.bincount(partition.owner(points), weights, nodes) / weights.sum() * nodes
    assert loads.max() < 1.6


@pytest.mark.parametrize("nodes", [3, 5, 16, 64])
def test_wedges_share_the_sample(nodes):
    points, weights = sample()
    partition = make_partition("bounded-radial", nodes, BOX, **CAMERA, sample_points=points, weights=weights, even_share=0.0)
    loads = np.bincount(partition.owner(points), weights, nodes) / weights.sum() * nodes
    assert loads.max() < (1.3 if nodes == 3 else 1.15)  # half a turn holds less than a third of it
    with_rays = make_partition("bounded-radial", nodes, BOX, **CAMERA, sample_points=points, weights=weights)
    loads = np.bincount(with_rays.owner(points), weights, nodes) / weights.sum() * nodes
    assert loads.max() < 1.5


@pytest.mark.parametrize("algorithm", ["voronoi", "bounded-radial"])
def test_the_order_of_the_sample_leaves_no_trace(algorithm):
    points, weights = sample(count=20_000)
    order = np.random.default_rng(2).permutation(len(points))
    one, other = (
        make_partition(algorithm, 7, BOX, **CAMERA, sample_points=p, weights=w)
        for p, w in ((points, weights), (points[order], weights[order]))
    )
    assert one == other


@pytest.mark.parametrize("nodes", COUNTS)
def test_without_a_sample_cells_are_even_around_the_camera(nodes):
    wedges = make_partition("bounded-radial", nodes, BOX, **CAMERA)
    ring = make_partition("voronoi", nodes, BOX, **CAMERA, sample_points=np.zeros((0, 3)))
    places = np.random.default_rng(4).normal(0, 5, (2000, 3))
    assert (wedges.owner(places) == ring.owner(places)).mean() > 0.999


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.zeros((200, 3)), np.array([[0.0, 0, 0], [1, 0, 0]])])
@pytest.mark.parametrize("algorithm", ["voronoi", "bounded-radial"])
@pytest.mark.parametrize("box", [BOX, np.zeros((2, 3)), np.array([[-1.0, -1, 0], [1, 1, 0]])])
def test_poor_samples_and_flat_boxes_still_make_cells(algorithm, points, box):
    for nodes in (1, 2, 5, 127):
        assert make_partition(algorithm, nodes, box, **CAMERA, sample_points=points).nodes == nodes


def test_what_cannot_be_is_said():
    with pytest.raises(LocalFault, match="bounded-radial"):
        make_partition("hexagons", 3, BOX, **CAMERA)
    with pytest.raises(LocalFault, match="127"):
        make_partition("voronoi", 128, BOX, **CAMERA)
    with pytest.raises(LocalFault, match="looks nowhere"):
        make_partition("voronoi", 3, BOX, [0, 0, 0], [0, 0, 0], [0, 0, 1])
    with pytest.raises(LocalFault, match="sample"):
        make_partition("voronoi", 3, BOX, **CAMERA, sample_points=[[np.nan, 0, 0]])
    with pytest.raises(LocalFault, match="box"):
        make_partition("voronoi", 3, BOX[::-1], **CAMERA)


def test_a_camera_that_looks_along_its_up_has_a_frame():
    frame = camera_frame([0, 0, 0], [0, 0, -2], [0, 0, 1])
    axes = np.array([frame.axis, frame.zero, frame.quarter])
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.allclose(np.cross(frame.zero, frame.quarter), frame.axis)


def test_the_camera_sees_fractions_grow_clockwise_from_twelve():
    frame = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])
    assert frame.fractions(np.array([[0.0, 1, -5], [1, 0, -5], [0, -1, 3], [-1, 0, 0]])).tolist() == [0.0, 0.25, 0.5, 0.75]


@pytest.mark.parametrize("nodes", COUNTS)
def test_placements(nodes):
    for cloud in (random(BOX, nodes, 5), van_der_corput(BOX, nodes), van_der_corput(BOX, nodes, 5)):
        assert cloud.shape == (nodes, 3)
        assert (cloud >= BOX[0]).all()
        assert (cloud <= BOX[1]).all()
        assert len(np.unique(cloud, axis=0)) == nodes
    assert (random(BOX, nodes, 5) == random(BOX, nodes, 5)).all()
    assert (random(BOX, nodes, 5) != random(BOX, nodes, 6)).any()
    depths = (planar(BOX, nodes, FRAME) - np.array(FRAME.origin)) @ np.array(FRAME.axis)
    assert (np.diff(depths) > 0).all()
    ring = radial(BOX, nodes, FRAME)
    x, y = FRAME.flat(ring)
    assert np.allclose(np.hypot(x, y), 2.5)
    assert np.allclose(FRAME.fractions(ring), (np.arange(nodes) + 0.5) / nodes)


def test_van_der_corput_mirrors_digits():
    cloud = van_der_corput([[0, 0, 0], [1, 1, 1]], 6)
    assert np.allclose(cloud[:, 0], [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8])
    assert np.allclose(cloud[:, 1], [1 / 3, 2 / 3, 1 / 9, 4 / 9, 7 / 9, 2 / 9])


def test_slices_are_the_cells_of_the_planar_placement():
    partition = Partition.voronoi(planar(BOX, 8, FRAME))
    across = np.random.default_rng(3).normal(0, 1, (200, 2)) @ np.array([FRAME.zero, FRAME.quarter])
    assert len(set(partition.owner(np.array([0.0, 0.0, 1.0]) + across))) == 1
