"""If this fails, nodes think that space is empty in which there is a triangle, or take what another one tells of that without looking."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.partition.occupancy import GRIDS_SHAPE, SHIFT, nothing_in
from scenefold.render.occupied import GRIDS_BYTES, packed_grids, united, unpacked_grids
from scenefold.render.occupied_kernels import mark_triangles


def marked(corners: np.ndarray, matrix: np.ndarray, dilation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The grids of triangles f64[n, 3, 3] under a matrix, in the box from -1 to 1; its low corner, and voxels a unit."""
    space = nothing_in(np.full(3, -1.0), np.ones(3))
    vertices = corners.reshape(-1, 3).astype(np.float32)
    triangles = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    pairs = np.zeros(1, np.int64), np.array([len(triangles)])
    mark_triangles(
        space.grids, space.low, space.per_voxel, np.array(SHIFT), vertices, triangles, *pairs, matrix[None], dilation, np.empty((3, 3))
    )
    return space.grids, space.low, space.per_voxel


def is_set(grids: np.ndarray, places: np.ndarray, low: np.ndarray, per_voxel: np.ndarray) -> np.ndarray:
    """Of each place whether its voxel is, bool[2, n]."""
    found = []
    for grid, shift in zip(grids, SHIFT, strict=True):
        i, j, k = np.floor((places - low) * per_voxel + shift).astype(np.int64).T
        found.append((grid[i, j, k >> 6] >> (k & 63).astype(np.uint64)) & np.uint64(1) != 0)
    return np.array(found)


@given(
    seed=st.integers(0, 2**32 - 1),
    size=st.sampled_from([1.0, 0.3, 0.01, 0.0]),
    dilation=st.sampled_from([0.0, 1e-4, 0.02]),
    scale=st.sampled_from([1.0, 0.5]),
)
@settings(max_examples=40, deadline=None)
def test_wherever_a_triangle_is_its_voxels_are_occupied(seed: int, size: float, dilation: float, scale: float) -> None:
    rng = np.random.default_rng(seed)
    corners = np.clip(rng.uniform(-1, 1, (12, 1, 3)) + size * rng.uniform(-1, 1, (12, 3, 3)), -1, 1).astype(np.float32).astype(np.float64)
    corners[0, :, 1] = corners[0, 0, 1]
    corners[1, 2] = corners[1, 1]
    matrix = np.concatenate([scale * np.linalg.qr(rng.normal(size=(3, 3)))[0] * 0.5, rng.uniform(-0.1, 0.1, (3, 1))], axis=1)
    grids, low, per_voxel = marked(corners, matrix, dilation)
    weights = rng.dirichlet(np.full(3, 0.5), (12, 300))
    places = (weights @ corners).reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
    near = places + dilation * rng.uniform(-1, 1, places.shape)
    assert is_set(grids, places, low, per_voxel).all() and is_set(grids, near, low, per_voxel).all()


def test_a_triangle_across_the_box_does_not_fill_it() -> None:
    grids, _, _ = marked(np.array([[[-1.0, -1, -1], [1, 1, -1], [1, 1, 1]]]), np.eye(3, 4), 0.0)
    share = np.unpackbits(grids[0].view(np.uint8)).mean()
    assert 1 / 512 < share < 1 / 30, "of about one voxel in 256 it has some"


def test_what_all_tell_is_what_any_has() -> None:
    rng = np.random.default_rng(1)
    some = [rng.integers(0, 2**63, GRIDS_SHAPE, np.uint64) & rng.integers(0, 2**63, GRIDS_SHAPE, np.uint64) for _ in range(3)]
    assert (unpacked_grids(united(map(packed_grids, some))) == (some[0] | some[1] | some[2])).all()
    assert not unpacked_grids(united([])).any()


@pytest.mark.parametrize(
    "packed",
    [
        None,
        7,
        b"",
        b"no such thing",
        zlib.compress(bytes(GRIDS_BYTES - 1)),
        zlib.compress(bytes(GRIDS_BYTES + 1)),
        zlib.compress(bytes(200 * GRIDS_BYTES)),
        zlib.compress(bytes(GRIDS_BYTES))[:-1],
        zlib.compress(bytes(GRIDS_BYTES)) + b"x",
        bytes(GRIDS_BYTES + 5000),
    ],
)
def test_what_is_no_grid_is_none(packed: object) -> None:
    with pytest.raises(PeerFault, match="ill-formed"):
        unpacked_grids(packed)
