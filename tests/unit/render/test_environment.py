"""If this fails, an environment map lights a scene from elsewhere, or more or less than it should."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.environment_kernels import fill_tables
from unit.render import lanes_probe_kernels as lanes

F32, F64 = npt.NDArray[np.float32], npt.NDArray[np.float64]
COUNT = 1 << 16


class Scene(NamedTuple):
    environment: F32
    environment_rows: F32
    environment_columns: F32


class Turned(NamedTuple):
    environment_cosine: float
    environment_sine: float


def scene(texels: F32) -> Scene:
    height, width = texels.shape[:2]
    rows, columns = np.empty(height + 1, np.float32), np.empty((height, width + 1), np.float32)
    fill_tables(texels, np.empty(height), rows, columns)
    return Scene(texels, rows, columns)


def turned(degrees: float) -> Turned:
    return Turned(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))


def noise(height: int, width: int) -> F32:
    """Mostly dark, with a sun, a black half and all between."""
    texels = (np.random.default_rng(3).random((height, width, 3)) ** 4).astype(np.float32)
    texels[height // 3, width // 4] = 500.0
    texels[height // 2 :, : width // 3] = 0.0
    return texels


MAPS = {"noise": noise(12, 20), "one texel": np.ones((1, 1, 3), np.float32), "a row": noise(1, 7), "a column": noise(9, 1)}


@pytest.mark.parametrize("name", MAPS)
def test_tables_are_probabilities_in_whole_steps(name: str) -> None:
    made = scene(MAPS[name])
    for table in (made.environment_rows[None], made.environment_columns):
        assert (table[:, 0] == 0).all() and (table[:, -1] == 1).all() and (np.diff(table) >= 0).all()
        assert np.array_equal(table * 2.0**24, np.floor(table * 2.0**24))


@pytest.mark.parametrize("degrees", [0.0, 75.0])
@pytest.mark.parametrize("name", MAPS)
def test_directions_are_drawn_with_the_density_that_is_told(name: str, degrees: float) -> None:
    texels = MAPS[name]
    numbers = np.random.default_rng(1).integers(0, 1 << 24, (COUNT, 2)) / 2.0**24
    drawn, seen = lanes.environment_drawn(scene(texels), turned(degrees), numbers)
    assert np.abs((drawn[:, :3] ** 2).sum(axis=1) - 1).max() < 1e-5
    # Who finds the direction by other means sees the same, but for the few that rounding moves over the edge of a texel.
    same = np.isclose(drawn[:, 6], seen[:, 3], rtol=1e-3)
    assert same.mean() > 0.998
    assert np.allclose(drawn[same, 3:6], seen[same, :3], rtol=2e-3, atol=1e-3 * texels.max())
    # Chi-square over patches of equal solid angle, by the integral of the density in each.
    expected = COUNT * patches_of(scene(texels), turned(degrees))
    counts = np.bincount(patch(drawn[:, :3]), minlength=len(expected))
    full = expected > 8
    rest = max(expected[~full].sum(), 1e-9)
    chi = ((counts - expected)[full] ** 2 / expected[full]).sum() + (counts[~full].sum() - rest) ** 2 / max(rest, 8.0)
    degrees_of_freedom = int(full.sum())
    assert chi < degrees_of_freedom + 4.5 * math.sqrt(2 * degrees_of_freedom) + 10
    # The integral of the radiance over the sphere, by both techniques.
    estimate = drawn[:, 3:6] / drawn[:, 6:7]
    uniform = lanes.environment_seen(scene(texels), turned(degrees), on_sphere(COUNT * 4))[:, :3].mean(axis=0) * 4 * math.pi
    error = estimate.std(axis=0) / math.sqrt(COUNT)
    assert (np.abs(estimate.mean(axis=0) - uniform) < 5 * error + 0.03 * uniform).all()


def test_the_density_integrates_to_one() -> None:
    for texels in MAPS.values():
        assert abs(lanes.environment_seen(scene(texels), turned(10.0), on_sphere(1 << 20))[:, 3].mean() * 4 * math.pi - 1) < 2e-3


def test_the_middle_is_ahead_and_what_is_right_in_it_is_right() -> None:
    texels = np.zeros((8, 16, 3), np.float32)
    texels[3:5, 7:9, 0] = 1.0  # the middle
    texels[3:5, 11:13, 1] = 1.0  # a quarter to its right
    texels[0, :, 2] = 1.0  # the top
    along = np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1], [0, 0, -1]], np.float64)
    made = scene(texels)
    seen = lanes.environment_seen(made, turned(0.0), along)[:, :3]
    assert np.allclose(seen[:3], np.eye(3), atol=1e-5) and not seen[3:6].any()
    # Turned counter-clockwise seen from above, what was ahead is to the left.
    seen = lanes.environment_seen(made, turned(90.0), along)[:, :3]
    assert np.allclose(seen[[4, 0, 2]], np.eye(3), atol=1e-5) and not seen[[1, 3, 5]].any()


def test_a_constant_map_is_constant_to_the_poles_and_across_the_seam() -> None:
    seen = lanes.environment_seen(scene(np.full((5, 9, 3), 0.25, np.float32)), turned(33.0), on_sphere(1 << 14))
    assert np.allclose(seen[:, :3], 0.25, rtol=1e-6)


def on_sphere(count: int) -> F64:
    """Evenly, by Fibonacci's spiral."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    phi = np.arange(count) * (math.pi * (3.0 - math.sqrt(5.0)))
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(phi), z, flat * np.sin(phi)], axis=1)


def patch(directions: F64) -> npt.NDArray[np.int64]:
    """Of 16 x 32 patches of one solid angle, the one that each direction lies in."""
    ring = np.minimum(((directions[:, 1] + 1.0) * 8.0).astype(np.int64), 15)
    sector = np.floor((np.arctan2(directions[:, 2], directions[:, 0]) / (2 * math.pi) % 1.0) * 32).astype(np.int64) % 32
    return ring * 32 + sector


def patches_of(made: Scene, turn: Turned) -> F64:
    """The share of each patch, by the density at many places."""
    directions = on_sphere(1 << 21)
    density = lanes.environment_seen(made, turn, directions)[:, 3]
    shares: F64 = np.bincount(patch(directions), weights=density, minlength=512)
    return shares / shares.sum()
