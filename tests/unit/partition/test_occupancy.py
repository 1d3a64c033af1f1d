"""If this fails, a ray skips a cell with something in it, and flies through a wall."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition, camera_frame, even_bounds
from scenefold.partition.occupancy import Occupancy, occupancy
from unit.partition.cells import SEEDS, centroids, cuts, directions, power

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def things(rng: np.random.Generator, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    low = rng.uniform(-1.0, 1.0 - size, (count, 3))
    return low, low + size * rng.uniform(0, 1, (count, 3))


def spans(low: np.ndarray, high: np.ndarray, origins: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each ray enters and leaves each box, by slabs: f64[n, m] twice; enters after it leaves: a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = ((edge[None] - origins[:, None]) / ways[:, None] for edge in (low, high))
    return np.minimum(one, two).max(axis=2), np.maximum(one, two).min(axis=2)


@given(SEEDS, st.sampled_from([0.0, 1e-4, 0.05, 0.4]), st.sampled_from([1.0, 1e-3, 1e4]), st.sampled_from([0.0, 1e3]))
@settings(max_examples=40)
def test_no_ray_skips_what_it_meets(seed, size, scale, away):
    rng = np.random.default_rng(seed)
    low, high = (scale * (edge + away) for edge in things(rng, 20, size))
    bitmap = occupancy(scale * (BOX + away), low, high)
    # Through points of the boxes, and anywhere; from inside of the scene's box, and outside.
    aims = np.concatenate([low + (high - low) * rng.uniform(0, 1, low.shape), scale * (rng.uniform(-1, 1, (60, 3)) + away)])
    origins = scale * (rng.uniform(-2, 2, aims.shape) + away)
    ways = aims - origins
    ends = np.sort(rng.uniform(0.0, 2.0, (len(aims), 2)), axis=1)
    ends[::3] = [0.0, np.inf]
    enter, leave = spans(low, high, origins, ways)
    meets = (np.maximum(enter, ends[:, :1]) <= np.minimum(leave, ends[:, 1:])).any(axis=1)
    assert bitmap.is_occupied(origins, ways, ends[:, 0], ends[:, 1])[meets].all()
    through = np.arange(len(low))
    assert bitmap.is_occupied(origins[through], ways[through], 1.0, 1.0).all()


def test_what_is_far_from_everything_is_empty():
    rng = np.random.default_rng(2)
    low, high = things(rng, 30, 0.05)
    bitmap = occupancy(BOX, low, high)
    origins, ways = rng.uniform(-1, 1, (4000, 3)), directions(rng, 4000)
    room = 3 * 2.0 / 127.0
    enter, leave = spans(low - room, high + room, origins, ways)
    clear = (np.maximum(enter, 0.0) > np.minimum(leave, 0.7)).all(axis=1)
    assert clear.sum() > 1000
    assert not bitmap.is_occupied(origins, ways, 0.0, 0.7)[clear].any()


def cells(rng: np.random.Generator) -> list[Partition]:
    frame = camera_frame([0, 0, 2], [0, 0, -1], [0, 1, 0])
    return [
        Partition.voronoi(centroids("scattered", 12, rng)),
        Partition.wedges(frame, even_bounds(9)),
        Partition.slabs(frame, [1.0, 1.5, 1.5, 2.0]),
        power("scattered", 12, rng),
        Partition.boxes(cuts(12, rng)),
    ]


@given(SEEDS)
@settings(max_examples=15)
def test_the_next_occupied_cell_is_no_later_than_what_the_ray_meets(seed):
    rng = np.random.default_rng(seed)
    low, high = things(rng, 12, 0.1)
    bitmap = occupancy(BOX, low, high)
    origins, ways = rng.uniform(-1, 1, (100, 3)), directions(rng, 100)
    enter, leave = spans(low, high, origins, ways)
    first = np.where(np.maximum(enter, 0.0) <= leave, np.maximum(enter, 0.0), np.inf).min(axis=1)
    for partition in cells(rng):
        node = partition.owner(origins, ways)
        t, target = bitmap.next_cells(partition, origins, ways, 0.0, node)
        assert (t <= first).all()
        assert ((target == -1) == np.isinf(t)).all()
        inside = np.isfinite(t)
        again, same = bitmap.next_cells(partition, origins[inside], ways[inside], t[inside], target[inside])
        assert (again == t[inside]).all()
        assert (same == target[inside]).all()


def test_nothing_flat_and_dilated_scenes():
    empty = occupancy(BOX, np.zeros((0, 3)), np.zeros((0, 3)))
    assert not empty.is_occupied([[0, 0, -5]], [[0, 0, 1]], 0.0, np.inf).any()
    for box in (np.zeros((2, 3)), np.array([[-1.0, -1, 0], [1, 1, 0]])):
        flat = occupancy(box, box[:1], box[1:])
        assert flat.is_occupied([[0, 0, -5], [0.0, 0, 5]], [[0, 0, 1], [0, 0, -1]], 0.0, np.inf).all()
    grown = occupancy(BOX, [[-1, -1, -1]], [[-1, -1, -1]], 0.5)
    assert grown.is_occupied([[-1.4, -1.4, -5]], [[0, 0, 1]], 0.0, np.inf).all()
    assert grown.grids.nbytes == 128**3 // 8 * 2
    assert isinstance(grown, Occupancy)


def test_what_cannot_be_is_said():
    for box, low, high, dilation in [
        (BOX, [[0, 0, 1]], [[0, 0, 0]], 0.0),
        (BOX, [[0, 0, 0]], [[0, 0, 2]], 0.0),
        (BOX, [[0, 0, 0]], [[0, 0, 0]], -1.0),
        (BOX[::-1], [[0, 0, 0]], [[0, 0, 0]], 0.0),
    ]:
        with pytest.raises(LocalFault):
            occupancy(box, low, high, dilation)
    with pytest.raises(LocalFault, match="rays"):
        occupancy(BOX, [[0, 0, 0]], [[0, 0, 0]]).is_occupied([0, 0, 0], [0, 0, 1], 0, 1)
    with pytest.raises(LocalFault, match="index"):
        occupancy(BOX, [[0, 0, 0]], [[0, 0, 0]]).next_cells(Partition.voronoi([[0, 0, 0]]), [[0, 0, 0]], [[0, 0, 1]], 0.0, 1)
