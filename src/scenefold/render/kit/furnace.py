"""Furnaces: light that comes evenly from everywhere shows what surfaces make or lose, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scenefold.render.contract import Renderer
from scenefold.render.kit.expecting import Z_MAX, expect, expect_mean, expect_nothing_lost
from scenefold.render.kit.gltf import albedo, mean_albedo
from scenefold.render.kit.rig import Rig
from scenefold.render.kit.shapes import ball, grid, looking, scene
from scenefold.scene.payloads.materials import Material

TOLERANCE = 0.005
Look = tuple[float, float, float]
"""Base colour, metallic, roughness."""
SURFACES: tuple[Look, ...] = (
    (1.0, 0.0, 1.0), (0.6, 0.0, 0.5), (1.0, 0.0, 0.1), (1.0, 0.0, 0.4), (0.5, 0.5, 0.2),
    (1.0, 1.0, 0.3), (1.0, 1.0, 0.8), (0.5, 1.0, 1.0), (0.8, 1.0, 0.05),
)  # fmt: skip
INSIDE: tuple[Look, ...] = ((0.5, 0.0, 0.4), (0.5, 1.0, 0.3), (0.8, 0.0, 0.3), (0.5, 1.0, 0.9))
_WHITE_SKY = (1.0, 1.0, 1.0)


def _surface(base: float, metallic: float, roughness: float, **more: object) -> Material:
    return Material(base_color=(base, base, base, 1.0), metallic=metallic, roughness=roughness, **more)  # type: ignore[arg-type]


def spheres_under_a_white_sky(renderer: Renderer, surfaces: Sequence[Look] = SURFACES, samples: int = 64) -> None:
    """Seen from far away a sphere shows all angles, each as often as a cosine-weighted hemisphere has it."""
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.05)
    for base, metallic, roughness in surfaces:
        what = f"a sphere of base colour {base}, metallic {metallic}, roughness {roughness} under a white sky"
        rig = Rig(scene([[ball((0, 0, 0), 1.0, 40, 0, smooth=True)]], [_surface(base, metallic, roughness)], [eye]), renderer, 200)
        image = rig.render(width=48, height=48, samples=samples, sky=_WHITE_SKY)
        expect_nothing_lost(image, what)
        hit = image.aovs[:, 7] == 1
        expect(0.65 < hit.mean() < 0.72, f"{what}: {hit.mean():.3f} of the paths hit it, expected 0.69 (aovs, the last column)")
        beside = image.radiance[~hit] / 2.0**32
        expect(np.abs(beside - 1.0).max() < 1e-3, f"{what}: beside it the sky is not 1, but up to {beside.max()}")
        given = image.radiance[hit, 0] / 2.0**32
        share = mean_albedo(base, metallic, roughness)
        error = Z_MAX * given.std() / np.sqrt(len(given)) + TOLERANCE
        good = abs(given.mean() - share) <= error
        expect(good, f"{what}: it gives back {given.mean():.4f}, expected {share:.4f}, give or take {error:.4f}")


def a_plane_under_a_grey_sky(renderer: Renderer) -> None:
    """A dull plane that sees nothing but sky, and so gives back its albedo of it."""
    base, roughness, sky = 0.5, 1.0, (0.2, 0.4, 0.8)
    eye = looking((0, 1, 0), (0, 0, 0), kind="orthographic", ymag=0.3)
    floor = grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 2, 0)
    image = Rig(scene([[floor]], [_surface(base, 0.0, roughness)], [eye]), renderer).render(width=16, height=16, samples=256, sky=sky)
    light = np.array(sky) * albedo(base, 0.0, roughness, 1.0)
    expect_mean(image, light * (1 - TOLERANCE), light * (1 + TOLERANCE), "a plane under a grey sky")


def inside_of_a_glowing_sphere(renderer: Renderer, nodes: int = 1, surfaces: Sequence[Look] = INSIDE, samples: int = 256) -> None:
    """Radiance is 1 wherever one looks: what the wall glows, and what it gives back of that, again and again (after pbrt's analytic scenes)."""
    for base, metallic, roughness in surfaces:
        what = f"inside of a sphere of base colour {base}, metallic {metallic}, roughness {roughness}, on {nodes} nodes"
        glow = 1.0 - mean_albedo(base, metallic, roughness)
        wall = _surface(base, metallic, roughness, emissive=(glow, glow, glow))
        eye = looking((0.1, 0.2, 0.0), (1.0, 0.1, 0.3), yfov=1.5)
        rig = Rig(scene([[ball((0, 0, 0), 1.0, 24, 0, inwards=True)]], [wall], [eye]), renderer, 100)
        image = rig.render("voronoi", nodes, width=24, height=24, samples=samples, depth=32)
        expect_nothing_lost(image, what)
        expect_mean(image, np.full(3, 0.975), np.full(3, 1.025), what, noise_max=0.04)


STATISTICAL = {
    "spheres under a white sky": spheres_under_a_white_sky,
    "a plane under a grey sky": a_plane_under_a_grey_sky,
    "inside of a glowing sphere": inside_of_a_glowing_sphere,
}
