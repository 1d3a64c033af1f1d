"""If this fails, a ray is passed over something that it meets, or stops where there is nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.partition.empty_walk_kernels import SIDE, fill_reach, firsts_met, mark_box
from scenefold.render import occupied
from scenefold.render.arrays import EmptySpace
from unit.partition.cells import SEEDS, directions

BOX = np.array([[-1.0, -1, -1], [1, 1, 1]])


def things(rng: np.random.Generator, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Boxes in BOX."""
    low = rng.uniform(-1.0, 1.0 - size, (count, 3))
    return low, low + size * rng.uniform(0, 1, (count, 3))


def spans(low: np.ndarray, high: np.ndarray, origins: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where each ray enters and leaves each box, by slabs: f64[n, m] twice; enters after it leaves: a miss."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = ((edge[None] - origins[:, None]) / ways[:, None] for edge in (low, high))
    return np.minimum(one, two).max(axis=2), np.maximum(one, two).min(axis=2)


def known(box: np.ndarray, low: np.ndarray, high: np.ndarray) -> EmptySpace:
    """What tracers know of a box f64[2, 3] in which these boxes lie, f64[m, 3] twice."""
    begin, end, per_voxel = occupied.voxels(*box)
    marked, reach = np.zeros((SIDE, SIDE, SIDE), np.uint8), np.empty((SIDE, SIDE, SIDE), np.uint8)
    for corner, other in zip(low, high, strict=True):
        mark_box(marked, begin, per_voxel, *corner, *other)
    fill_reach(marked, reach)
    return EmptySpace(reach, begin, end, per_voxel)


def first(empty: EmptySpace, origins: np.ndarray, ways: np.ndarray, t_from: object, t_to: object) -> np.ndarray:
    begin, end = (np.ascontiguousarray(np.broadcast_to(np.asarray(t, np.float64), len(origins))) for t in (t_from, t_to))
    found = np.empty(len(origins))
    firsts_met(empty, np.ascontiguousarray(origins), np.ascontiguousarray(ways), begin, end, found)
    return found


@pytest.mark.parametrize("count", [0, 1, 3, 2000])
def test_reach_is_the_distance_to_the_next_occupied_voxel(count: int) -> None:
    rng = np.random.default_rng(count)
    places = rng.integers(0, SIDE, (count, 3))
    marked, reach = np.zeros((SIDE, SIDE, SIDE), np.uint8), np.empty((SIDE, SIDE, SIDE), np.uint8)
    marked[tuple(places.T)] = 1
    fill_reach(marked, reach)
    for _ in range(300):
        at = rng.integers(0, SIDE, 3)
        assert reach[tuple(at)] == (int(np.abs(places - at).max(axis=1).min()) if count else SIDE)
    assert all(reach[tuple(place)] == 0 for place in places)
    assert occupied.SIDE == SIDE


@given(SEEDS, st.sampled_from([0.0, 1e-4, 0.05, 0.4]), st.sampled_from([1.0, 1e-3, 1e4]), st.sampled_from([0.0, 1e3]))
@settings(max_examples=40)
def test_no_ray_is_passed_over_what_it_meets(seed: int, size: float, scale: float, away: float) -> None:
    rng = np.random.default_rng(seed)
    low, high = (scale * (edge + away) for edge in things(rng, 20, size))
    empty = known(scale * (BOX + away), low, high)
    aims = np.concatenate([low + (high - low) * rng.uniform(0, 1, low.shape), scale * (rng.uniform(-1, 1, (60, 3)) + away)])
    origins = scale * (rng.uniform(-2, 2, aims.shape) + away)
    ways = aims - origins
    # Along axes, too, and along the walls of voxels.
    ways[::5] *= np.eye(3)[rng.integers(0, 3, len(ways[::5]))]
    ends = np.sort(rng.uniform(0.0, 2.0, (len(aims), 2)), axis=1)
    ends[::3] = [0.0, np.inf]
    with np.errstate(invalid="ignore"):
        enter, leave = spans(low, high, origins, ways)
    enter, leave = np.maximum(enter, ends[:, :1]), np.minimum(leave, ends[:, 1:])
    meets = np.where(enter <= leave, enter, np.inf).min(axis=1)
    found = first(empty, origins, ways, ends[:, 0], ends[:, 1])
    # Where a ray lies in the side of a box the slabs are no numbers.
    assert (found <= np.where(np.isnan(meets), np.inf, meets)).all()
    assert (found >= ends[:, 0]).all() and ((found <= ends[:, 1]) | np.isinf(found)).all()


def test_it_stops_no_sooner_than_near_something() -> None:
    rng = np.random.default_rng(2)
    low, high = things(rng, 120, 0.2)
    empty = known(BOX, low, high)
    origins, ways = rng.uniform(-1, 1, (4000, 3)), directions(rng, 4000)
    found = first(empty, origins, ways, 0.0, 0.7)
    room = 2 * 2.0 / 63.0
    enter, leave = spans(low - room, high + room, origins, ways)
    near = np.where(np.maximum(enter, 0.0) <= np.minimum(leave, 0.7), np.maximum(enter, 0.0), np.inf).min(axis=1)
    assert (found >= near).all()
    assert np.isinf(found).sum() > 1000 and (found == 0.0).sum() > 10 and ((found > 0.0) & np.isfinite(found)).sum() > 300


def test_where_it_stops_it_stops_again() -> None:
    rng = np.random.default_rng(3)
    empty = known(BOX, *things(rng, 30, 0.1))
    origins, ways = rng.uniform(-1, 1, (500, 3)), directions(rng, 500)
    found = first(empty, origins, ways, 0.0, np.inf)
    stopped = np.isfinite(found)
    assert (first(empty, origins[stopped], ways[stopped], found[stopped], np.inf) == found[stopped]).all()


def test_rays_that_stand_still_or_never_come_near() -> None:
    empty = known(BOX, np.full((1, 3), -0.1), np.full((1, 3), 0.1))
    origins = np.array([[0.0, 0, 0], [0.9, 0.9, 0.9], [5.0, 0, 0], [5.0, 0, 0], [-5.0, 0, 0], [0.0, 5.0, 0.0]])
    ways = np.array([[0.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
    found = first(empty, origins, ways, 0.0, np.inf)
    assert found[0] == 0.0 and np.isinf(found[[2, 3, 5]]).all() and 4.8 < found[4] <= 4.9
