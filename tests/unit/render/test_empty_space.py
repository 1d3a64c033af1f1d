"""If this fails, a ray goes past a triangle, as if nothing were there; or a map of empty space from another node does harm."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.partition.leaps import NO_LEAPS
from scenefold.partition.occupancy import first_near
from scenefold.render import empty_space
from scenefold.render.contract import HeldGroup, HeldScene
from scenefold.render.empty_space import DILATION, PACKED_BYTES_MAX, joined, leaps_of, marks_of, packed, unpacked

SEEDS = st.integers(0, 2**32 - 1)


class _Arrays:
    """What is read of `SceneArrays`."""

    def __init__(self, vertices: Any, triangles: Any, group_first: Any, matrices: Any) -> None:
        self.vertices, self.triangles = vertices.astype(np.float32), triangles.astype(np.uint32)
        self.group_first, self.instance_matrices = np.array(group_first, np.int64), np.array(matrices, np.float64)


class _Numbers:
    def __init__(self, low: Any, high: Any) -> None:
        self.box_low, self.box_high = np.asarray(low, np.float64), np.asarray(high, np.float64)


def scene(rng: np.random.Generator, size: float, scale: float) -> tuple[Any, Any, Any]:
    """Two groups, the second of which is placed three times: what a node holds, the job's numbers, corners f64[n, 3, 3] in the world."""
    corners = scale * (rng.uniform(-1, 1, (24, 1, 3)) + size * rng.uniform(-1, 1, (24, 3, 3)))
    # Walls, as rooms have them, and needles.
    corners[0] = scale * np.array([[-1, -1, 0.3], [1, -1, 0.3], [1, 1, 0.3]])
    corners[1, 2] = corners[1, 1]
    matrices = [np.eye(4)[:3] for _ in range(4)]
    for matrix in matrices[2:]:
        matrix[:, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.2, 1.5, 3)
        matrix[:, 3] = scale * rng.uniform(-0.5, 0.5, 3)
    arrays = _Arrays(corners.reshape(-1, 3), np.arange(72).reshape(24, 3), [0, 12], matrices)
    held = HeldScene(arrays, (HeldGroup(0, 0, 12), HeldGroup(1, 1, 12)), ((1, 1), (2, 1), (3, 1)))  # type: ignore[arg-type]
    flat = arrays.vertices.astype(np.float64).reshape(24, 3, 3)
    placed = [flat[:12], *(flat[12:] @ matrix[:, :3].T + matrix[:, 3] for matrix in arrays.instance_matrices[1:])]
    world = np.concatenate(placed)
    low, high = world.min(axis=(0, 1)), world.max(axis=(0, 1))
    room = 1e-4 * np.linalg.norm(high - low)
    return held, _Numbers(low - room, high + room), world


@given(SEEDS, st.sampled_from([0.01, 0.1, 0.8]), st.sampled_from([1.0, 1e-3, 1e4]))
@settings(max_examples=20, deadline=None)
def test_no_ray_goes_past_a_triangle(seed: int, size: float, scale: float) -> None:
    rng = np.random.default_rng(seed)
    held, numbers, world = scene(rng, size, scale)
    leaps = leaps_of(packed(marks_of(held, numbers)), numbers)
    shares = rng.dirichlet((0.5, 0.5, 0.5), len(world))
    points = (world * shares[:, :, None]).sum(axis=1)
    # Beside a triangle, too, by less than what marks is grown by.
    diagonal = float(np.linalg.norm(numbers.box_high - numbers.box_low))
    aside = rng.normal(size=points.shape)
    points = points + 0.99 * DILATION * diagonal * aside / np.linalg.norm(aside, axis=1)[:, None] * rng.uniform(0, 1, (len(points), 1))
    origins = scale * rng.uniform(-2, 2, points.shape)
    ways = points - origins
    assert (first_near(leaps, origins, ways, 0.0, np.inf) <= 1.0).all()
    assert (first_near(leaps, origins, ways, 1.0, 1.0) == 1.0).all()
    assert (first_near(leaps, points, rng.normal(size=points.shape), 0.0, 1e-3) == 0.0).all()


def test_what_is_far_from_every_triangle_is_empty() -> None:
    """A wall across a room leaves both halves empty, though its box may fill the room."""
    corners = np.array([[-1.0, -1, -1], [1, 1, -1], [1, 1, 1], [-1, -1, 1]])
    arrays = _Arrays(corners, np.array([[0, 1, 2], [0, 2, 3]]), [0], [np.eye(4)[:3]])
    held = HeldScene(arrays, (HeldGroup(0, 0, 2),), ())  # type: ignore[arg-type]
    numbers: Any = _Numbers(corners.min(axis=0) - 1e-3, corners.max(axis=0) + 1e-3)
    leaps = leaps_of(packed(marks_of(held, numbers)), numbers)
    rng = np.random.default_rng(3)
    starts = rng.uniform(-1, 1, (2000, 3))
    ends = rng.uniform(-1, 1, (2000, 3))
    side = np.stack([starts[:, 0] - starts[:, 1], ends[:, 0] - ends[:, 1]])
    clear = (np.abs(side) > 0.1).all(axis=0) & (np.sign(side[0]) == np.sign(side[1]))
    across = (np.abs(side) > 0.1).all(axis=0) & (np.sign(side[0]) != np.sign(side[1]))
    assert clear.sum() > 500
    assert np.isinf(first_near(leaps, starts, ends - starts, 0.0, 1.0)[clear]).all()
    assert np.isfinite(first_near(leaps, starts, ends - starts, 0.0, 1.0)[across]).all()


@given(SEEDS)
@settings(max_examples=8, deadline=None)
def test_leaps_are_distances_to_what_is_set(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grids = np.zeros((1, 128, 128, 2), np.uint64)
    places = rng.integers(0, 128, (rng.integers(1, 6), 3))
    for i, j, k in places:
        grids[0, i, j, k >> 6] |= np.uint64(1) << np.uint64(k & 63)
    distances = leaps_of(packed(grids), _Numbers([0, 0, 0], [1, 1, 1])).distances[0]  # type: ignore[arg-type]
    looks = rng.integers(0, 128, (200, 3))
    expected = np.abs(looks[:, None] - places[None]).max(axis=2).min(axis=1)
    assert (distances[tuple(looks.T)] == expected).all()


def test_all_nodes_together() -> None:
    rng = np.random.default_rng(5)
    parts = [(rng.random((2, 128, 128, 2)) < 0.01).astype(np.uint64) << np.uint64(shift) for shift in (0, 9, 63)]
    assert (unpacked(joined(map(packed, parts))) == parts[0] | parts[1] | parts[2]).all()
    assert joined([packed(parts[0]), b"", packed(parts[1])]) == b"", "who told nothing may hold anything"
    assert joined([]) == b""
    one_grid = packed(parts[1][:1])
    assert (unpacked(joined([packed(parts[0]), one_grid])) == parts[0][:1] | parts[1][:1]).all()
    assert not len(leaps_of(b"", _Numbers([0, 0, 0], [1, 1, 1])).distances)  # type: ignore[arg-type]
    assert first_near(NO_LEAPS, [[0, 0, -5]], [[0, 0, 1]], 0.5, 1.0) == 0.5


def test_what_is_too_ragged_is_told_by_half_or_not_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    ragged = rng.integers(0, 2**63, (2, 128, 128, 2)).astype(np.uint64)
    assert packed(ragged) == b""
    half = ragged.copy()
    half[0] = 0
    assert len(unpacked(packed(half))) == 1
    size = len(packed(half[:1]))
    monkeypatch.setattr(empty_space, "PACKED_BYTES_MAX", size - 1)
    assert packed(half) == b""


BOMB = zlib.compress(bytes(1 << 26))


@pytest.mark.parametrize(
    "payload",
    [
        None,
        7,
        "text",
        b"no stream",
        zlib.compress(bytes(5)),
        BOMB,
        zlib.compress(bytes(128**3 // 8)) + b"more",
        bytes(PACKED_BYTES_MAX + 1),
    ],
    ids=["none", "number", "text", "garbage", "short", "bomb", "behind", "long"],
)
def test_what_is_no_map_is_refused(payload: object) -> None:
    with pytest.raises(PeerFault, match="ill-formed"):
        unpacked(payload)
    with pytest.raises(PeerFault, match="ill-formed"):
        joined([payload])
