"""If this fails, nodes think that space is empty in which there is a triangle, or take what another one tells of that without looking."""

from __future__ import annotations

import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.render.occupied import BITS_BYTES, SIDE, packed, united, unpacked, voxels
from scenefold.render.occupied_kernels import mark_triangles


def marked(corners: np.ndarray, matrix: np.ndarray, dilation: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The voxels of triangles f64[n, 3, 3] under a matrix, in the box from -1 to 1; its low corner, and voxels a unit."""
    low, _, per_voxel = voxels(np.full(3, -1.0), np.ones(3))
    occupied = np.zeros((SIDE, SIDE, SIDE), np.uint8)
    vertices = corners.reshape(-1, 3).astype(np.float32)
    triangles = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
    pairs = np.zeros(1, np.int64), np.array([len(triangles)])
    mark_triangles(occupied, low, per_voxel, vertices, triangles, *pairs, matrix[None], np.array([dilation]), np.empty((3, 3)))
    return occupied, low, per_voxel


def is_set(occupied: np.ndarray, places: np.ndarray, low: np.ndarray, per_voxel: np.ndarray) -> np.ndarray:
    """Of each place whether its voxel is, bool[n]."""
    found: np.ndarray = occupied[tuple(np.floor((places - low) * per_voxel).astype(np.int64).T)] != 0
    return found


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
    occupied, low, per_voxel = marked(corners, matrix, dilation)
    weights = rng.dirichlet(np.full(3, 0.5), (12, 300))
    places = (weights @ corners).reshape(-1, 3) @ matrix[:, :3].T + matrix[:, 3]
    near = places + dilation * rng.uniform(-1, 1, places.shape)
    assert (
        is_set(occupied, places, low, per_voxel).all()
        and is_set(occupied, np.clip(near, low, low + (SIDE - 1e-9) / per_voxel), low, per_voxel).all()
    )


def test_a_triangle_across_the_box_does_not_fill_it() -> None:
    occupied, _, _ = marked(np.array([[[-1.0, -1, -1], [1, 1, -1], [1, 1, 1]]]), np.eye(3, 4), 0.0)
    assert 1 / 256 < occupied.mean() < 1 / 20, "of about one voxel in 128 it has some"


def test_what_all_tell_is_what_any_has() -> None:
    rng = np.random.default_rng(1)
    some = [(rng.random((SIDE, SIDE, SIDE)) < 0.1).astype(np.uint8) for _ in range(3)]
    assert (unpacked(united(map(packed, some))) == (some[0] | some[1] | some[2])).all()
    assert not unpacked(united([])).any()


@pytest.mark.parametrize(
    "told",
    [
        None,
        7,
        b"",
        b"no such thing",
        zlib.compress(bytes(BITS_BYTES - 1)),
        zlib.compress(bytes(BITS_BYTES + 1)),
        zlib.compress(bytes(200 * BITS_BYTES)),
        zlib.compress(bytes(BITS_BYTES))[:-1],
        zlib.compress(bytes(BITS_BYTES)) + b"x",
        bytes(2 * BITS_BYTES + 1),
    ],
)
def test_what_is_no_word_of_voxels_is_none(told: object) -> None:
    with pytest.raises(PeerFault, match="ill-formed"):
        unpacked(told)
