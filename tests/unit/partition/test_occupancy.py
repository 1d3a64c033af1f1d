"""If this fails, a ray skips a cell with something in it, and flies through a wall."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition.occupancy import Occupancy, first_near, nothing_in, occupancy
from unit.partition.cells import SEEDS, directions

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def things(rng: np.random.Generator, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    low = rng.uniform(-1.0, 1.0 - size, (count, 3))
    return low, low + size * rng.uniform(0, 1, (count, 3))


def meets_something(*args):
    return np.isfinite(first_near(*args))


def spans(low: np.ndarray, high: np.ndarray, origins: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each ray enters and leaves each box, by slabs: f64[n, m] twice; enters after it leaves: a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = ((edge[None] - origins[:, None]) / ways[:, None] for edge in (low, high))
    return np.minimum(one, two).max(axis=2), np.maximum(one, two).min(axis=2)


@given(SEEDS, st.sampled_from([0.0, 1e-4, 0.05, 0.4]), st.sampled_from([1.0, 1e-3, 1e4]), st.sampled_from([0.0, 1e3]))
@settings(max_examples=15)
def test_no_ray_skips_what_it_meets(seed, size, scale, away):
    rng = np.random.default_rng(seed)
    low, high = (scale * (edge + away) for edge in things(rng, 20, size))
    leaps = occupancy(scale * (BOX + away), low, high).leaps()
    # Through points of the boxes, and anywhere; from inside of the scene's box, and outside.
    aims = np.concatenate([low + (high - low) * rng.uniform(0, 1, low.shape), scale * (rng.uniform(-1, 1, (60, 3)) + away)])
    origins = scale * (rng.uniform(-2, 2, aims.shape) + away)
    ways = aims - origins
    ends = np.sort(rng.uniform(0.0, 2.0, (len(aims), 2)), axis=1)
    ends[::3] = [0.0, np.inf]
    enter, leave = spans(low, high, origins, ways)
    meets = (np.maximum(enter, ends[:, :1]) <= np.minimum(leave, ends[:, 1:])).any(axis=1)
    assert meets_something(leaps, origins, ways, ends[:, 0], ends[:, 1])[meets].all()
    through = np.arange(len(low))
    assert meets_something(leaps, origins[through], ways[through], 1.0, 1.0).all()


def test_what_is_far_from_everything_is_empty():
    rng = np.random.default_rng(2)
    low, high = things(rng, 30, 0.05)
    leaps = occupancy(BOX, low, high).leaps()
    origins, ways = rng.uniform(-1, 1, (4000, 3)), directions(rng, 4000)
    room = 3 * 2.0 / 127.0
    enter, leave = spans(low - room, high + room, origins, ways)
    clear = (np.maximum(enter, 0.0) > np.minimum(leave, 0.7)).all(axis=1)
    assert clear.sum() > 1000
    assert not meets_something(leaps, origins, ways, 0.0, 0.7)[clear].any()


@given(SEEDS)
@settings(max_examples=8)
def test_a_ray_goes_no_farther_than_what_it_meets(seed):
    rng = np.random.default_rng(seed)
    low, high = things(rng, 12, 0.1)
    leaps = occupancy(BOX, low, high).leaps()
    origins, ways = rng.uniform(-1, 1, (300, 3)), directions(rng, 300)
    enter, leave = spans(low, high, origins, ways)
    first = np.where(np.maximum(enter, 0.0) <= leave, np.maximum(enter, 0.0), np.inf).min(axis=1)
    t = first_near(leaps, origins, ways, 0.0, np.inf)
    assert (t <= first).all()
    # Nor much less far: boxes fill a small part of the room.
    assert np.isinf(t).mean() > 0.5 * np.isinf(first).mean()
    near = np.isfinite(t)
    assert (first_near(leaps, origins[near], ways[near], t[near], np.inf) == t[near]).all()


def test_nothing_flat_and_dilated_scenes():
    empty = occupancy(BOX, np.zeros((0, 3)), np.zeros((0, 3)))
    assert not meets_something(empty.leaps(), [[0, 0, -5]], [[0, 0, 1]], 0.0, np.inf).any()
    for box in (np.zeros((2, 3)), np.array([[-1.0, -1, 0], [1, 1, 0]])):
        flat = occupancy(box, box[:1], box[1:])
        assert meets_something(flat.leaps(), [[0, 0, -5], [0.0, 0, 5]], [[0, 0, 1], [0, 0, -1]], 0.0, np.inf).all()
    grown = occupancy(BOX, [[-1, -1, -1]], [[-1, -1, -1]], 0.5)
    assert meets_something(grown.leaps(), [[-1.4, -1.4, -5]], [[0, 0, 1]], 0.0, np.inf).all()
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
        first_near(nothing_in(BOX).leaps(), [0, 0, 0], [0, 0, 1], 0, 1)
