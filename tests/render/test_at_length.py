"""If this fails, images are a little too bright or too dark somewhere in the range of surfaces that the short tests leave out."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.contract import load_renderer
from scenefold.render.kit.furnace import inside_of_a_glowing_sphere, spheres_under_a_white_sky
from unit.render.test_bsdf_kernels import SURFACES, seen_from

Floats = npt.NDArray[np.float64]
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

GRID = [(base, metallic, roughness) for base in (0.5, 1.0) for metallic in (0.0, 0.5, 1.0) for roughness in (0.1, 0.4, 0.7, 1.0)]
INSIDE = [(base, metallic, roughness) for base in (0.3, 0.8) for metallic in (0.0, 1.0) for roughness in (0.1, 0.3)]


@pytest.mark.parametrize("look", GRID, ids=str)
def test_spheres_under_a_white_sky(look: tuple[float, float, float]) -> None:
    spheres_under_a_white_sky(load_renderer("embree"), [look], samples=512)


@pytest.mark.parametrize("look", INSIDE, ids=str)
@pytest.mark.parametrize("nodes", [1, 5])
def test_inside_of_a_glowing_sphere(look: tuple[float, float, float], nodes: int) -> None:
    inside_of_a_glowing_sphere(load_renderer("embree"), nodes, [look], samples=2048)


# Chi-square of the samplers ------------------------------------------------------------------------------

DRAWS = 2_000_000
ROWS, COLUMNS, WITHIN = 20, 40, 16
"""Bins of height and azimuth, and points by which a bin's share is integrated, on each side."""
COUNT_MIN = 5.0
WIDE = [name for name, surface in SURFACES.items() if surface.alpha >= 0.1]
"""The others' peaks are narrower than a bin: what falls into it says little."""


def expected_shares(name: str, wo: Floats) -> Floats:
    """Of a sampler's directions, how many fall into each bin: its density integrated, float64[ROWS, COLUMNS]."""
    z = (np.arange(ROWS * WITHIN) + 0.5) / (ROWS * WITHIN)
    turn = (np.arange(COLUMNS * WITHIN) + 0.5) / (COLUMNS * WITHIN) * 2 * math.pi - math.pi
    height, angle = (axis.ravel() for axis in np.meshgrid(z, turn, indexing="ij"))
    flat = np.sqrt(1 - height**2)
    density = SURFACES[name].evaluate(wo, np.stack([flat * np.cos(angle), flat * np.sin(angle), height], axis=1))[:, 3]
    shares: Floats = density.reshape(ROWS, WITHIN, COLUMNS, WITHIN).mean(axis=(1, 3)) * 2 * math.pi / (ROWS * COLUMNS)
    return shares


@pytest.mark.parametrize("angle", [0.02, 0.6, 1.2])
@pytest.mark.parametrize("name", WIDE)
def test_directions_are_drawn_as_their_density_says(name: str, angle: float) -> None:
    wo = seen_from(angle)
    wi = SURFACES[name].sample(wo, DRAWS)
    wi = wi[wi[:, 2] > 0]
    counts = np.histogram2d(wi[:, 2], np.arctan2(wi[:, 1], wi[:, 0]), (ROWS, COLUMNS), ((0, 1), (-math.pi, math.pi)))[0].ravel()
    expected = expected_shares(name, wo).ravel() * DRAWS
    kept = expected >= COUNT_MIN
    freedom = int(kept.sum()) - 1
    assert freedom > 50
    deviation = ((counts[kept] - expected[kept]) ** 2 / expected[kept]).sum()
    assert (deviation - freedom) / math.sqrt(2 * freedom) < 5, f"chi-square {deviation:.0f} at {freedom} degrees of freedom"
    assert abs(counts[~kept].sum() - expected[~kept].sum()) < 5 * math.sqrt(max(expected[~kept].sum(), 25.0))
