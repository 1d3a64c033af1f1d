"""If this fails, light is made or lost between surfaces: images are too bright or too dark, whatever they show.

What a surface gives back of even light from all sides is taken from its own formula by quadrature (albedo_of), so
these tests judge all the rest: light sampling, weights, roulette, coding of colours, casting, sums.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import ball, looking, scene
from scenefold.scene.payloads.materials import Material
from unit.render import probe_kernels as probe


def albedo_of(base: float, roughness: float, metallic: float) -> float:
    """Of light from all sides, the share given back to all sides (cosine-weighted)."""
    rows, count, alpha, reflection = 100, 4000, max(roughness**2, 1e-3), (0.04, 0.04, 0.04, 1.0)
    total = 0.0
    for row in range(rows):
        z = math.sqrt((row + 0.5) / rows)
        wo = np.array([math.sqrt(1 - z * z), 0.0, z])
        wi = probe.scattered(wo, np.full(3, base), metallic, alpha, reflection, 0.0, np.random.default_rng(row).random((count, 3)))
        wi = wi[wi[:, 2] > 0]
        values = probe.evaluations(np.tile(wo, (len(wi), 1)), wi, np.full(3, base), metallic, alpha, reflection, 0.0)
        total += (values[:, 0] * wi[:, 2] / values[:, 3]).sum() / count
    return float(total / rows)


def test_albedo_of_a_dull_surface_is_near_its_color() -> None:
    assert albedo_of(0.5, 1.0, 0.0) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(("base", "roughness", "metallic"), [(0.5, 1.0, 0.0), (0.8, 0.7, 0.0), (0.5, 0.6, 1.0)])
@pytest.mark.parametrize("nodes", [1, 3])
def test_inside_of_a_glowing_sphere(base: float, roughness: float, metallic: float, nodes: int) -> None:
    """Radiance is the same everywhere: what glows, and what is given back of it, again and again."""
    albedo = albedo_of(base, roughness, metallic)
    glow = 1.0 - albedo
    wall = Material(base_color=(base, base, base, 1.0), roughness=roughness, metallic=metallic, emissive=(glow, glow / 2, 2 * glow))
    eye = looking((0.1, 0.2, 0.0), (1.0, 0.1, 0.3), yfov=1.5)
    rig = Rig(scene([[ball((0, 0, 0), 1.0, 24, 0, inwards=True)]], [wall], [eye]), 100)
    image = rig.render("voronoi", nodes, width=32, height=32, samples=128, depth=32)
    mean = image.beauty.mean(axis=(0, 1))
    error = 4 * np.sqrt(image.variance.mean(axis=(0, 1)) / 32**2)
    assert (np.abs(mean / [1.0, 0.5, 2.0] - 1) < 0.01 + error).all(), mean
    assert image.counters[1:].tolist() == [0, 0]


@pytest.mark.parametrize(("base", "roughness", "metallic"), [(1.0, 1.0, 0.0), (0.6, 0.5, 0.0), (1.0, 0.3, 1.0), (0.8, 0.05, 1.0)])
def test_a_sphere_under_an_even_sky(base: float, roughness: float, metallic: float) -> None:
    """Seen from far away a sphere shows all angles, each as often as a cosine-weighted hemisphere has it."""
    surface = Material(base_color=(base, base, base, 1.0), roughness=roughness, metallic=metallic)
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.05)
    rig = Rig(scene([[ball((0, 0, 0), 1.0, 40, 0, smooth=True)]], [surface], [eye]), 200)
    image = rig.render("voronoi", 2, width=64, height=64, samples=64, sky=(1.0, 1.0, 1.0))
    hit = image.aovs[:, 7] == 1
    assert np.abs(image.radiance[~hit] / 2**32 - 1).max() < 1e-9, "sky where there is nothing else"
    given = image.radiance[hit, 0] / 2**32
    error = 4 * given.std() / math.sqrt(len(given))
    assert abs(given.mean() - albedo_of(base, roughness, metallic)) < 0.008 + error


def test_a_sphere_of_glass_that_is_not_there() -> None:
    """Full transmission without refraction: what is behind is seen, and shadows are not cast."""
    clear = Material(base_color=(1.0, 1.0, 1.0, 1.0), transmission=1.0, ior=1.0, roughness=0.1)
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.05)
    rig = Rig(scene([[ball((0, 0, 0), 1.0, 12, 0)]], [clear], [eye]), 40)
    image = rig.render("voronoi", 2, width=24, height=24, samples=32, sky=(1.0, 1.0, 1.0))
    assert image.beauty.mean() == pytest.approx(1.0, abs=0.01)
