"""If this fails, light that falls through panes, from spots, or from surfaces with holes is too bright or too dark.

A floor seen straight from above, lit by one lamp, with nothing else to give light back: a pixel is one integral, which
numpy does here from the formulas of specs/09 (roughness 1).
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import grid, looking, part, scene
from scenefold.render import ggx_albedo
from scenefold.render.kit import gltf
from scenefold.scene.importers.source import MeshPart
from scenefold.scene.payloads.materials import AlphaMode, Material
from scenefold.scene.payloads.punctual import PunctualLight

Floats = npt.NDArray[np.float64]
FLOOR = np.array([0.5, 0.6, 0.7])
LAMP = np.array([0.3, 2.0, 0.1])
POWER = 10.0
HALF = 0.2
"""Of the view's side; as wide as high."""
PIXELS = 8
EYE = looking((0, 0.3, 0), (0, 0, 0), kind="orthographic", ymag=HALF)


def floor_lit_from(place: Floats, half: float = HALF, *, side: int = 256) -> tuple[Floats, Floats]:
    """Radiance f64[side², 3] that leaves points all over the view upwards, and the unit directions to the lamp."""
    steps = (2 * np.arange(side) + 1) / side - 1
    x, z = (axis.ravel() * half for axis in np.meshgrid(steps, steps))
    towards = place - np.stack([x, 0 * x, z], axis=1)
    distance = np.sqrt((towards**2).sum(axis=1))
    towards /= distance[:, None]
    # In the surface's frame, whose z is the world's y.
    up, wi = np.broadcast_to([0.0, 0.0, 1.0], towards.shape), towards[:, [0, 2, 1]]
    light: Floats = gltf.value(FLOOR, 0.0, 1.0, up, wi) * (towards[:, 1] * POWER / distance**2)[:, None]
    return light, towards


def passing(cosine: Floats, roughness: float, f0: float = gltf.F0) -> Floats:
    """The share of light that a pane's layer leaves to what lies under it, at these angles."""
    share: Floats = ggx_albedo.left_of(f0, ggx_albedo.albedo(roughness, cosine), ggx_albedo.mean_albedo(roughness))[..., 0]
    return share


def floor_and(*others: MeshPart) -> list[list[MeshPart]]:
    return [[grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 6, 0)], *([other] for other in others)]


def pane(height: float) -> MeshPart:
    return grid((-1.5, height, 1.5), (3, 0, 0), (0, 0, -3), 4, 1)


def assert_mean(image: Rendered, expected: Floats, least: float = 0.0) -> None:
    mean = image.beauty.mean(axis=(0, 1))
    error = 4 * np.sqrt(image.variance.sum(axis=(0, 1))) / PIXELS**2
    assert (error <= 0.05 * expected + least).all(), "too few samples to tell"
    assert (np.abs(mean - expected) <= error + 1e-4 * expected).all(), (mean, expected, error)


@pytest.mark.parametrize(("tint", "panes"), [((1.0, 1.0, 1.0), 1), ((0.9, 0.5, 0.2), 1), ((0.9, 0.6, 0.4), 2), ((0.9, 0.0, 0.4), 1)])
def test_a_lamp_behind_panes(tint: tuple[float, float, float], panes: int) -> None:
    """No other ray finds a point: what a tint lets pass must reach the floor in the shadow ray, channel by channel."""
    glass = Material(base_color=(*tint, 1.0), transmission=0.9, roughness=0.1)
    lamp = PunctualLight(kind="point", position=(LAMP[0], LAMP[1], LAMP[2]), color=(POWER,) * 3)
    heights = [0.5 + 0.2 * number for number in range(panes)]
    source = scene(floor_and(*map(pane, heights)), [Material(base_color=(*FLOOR, 1.0)), glass], [EYE], punctual=[lamp])
    image = Rig(source, 12).render("voronoi", 1, width=PIXELS, height=PIXELS, samples=1200, depth=2)
    light, towards = floor_lit_from(LAMP)
    passed = 0.9 * passing(towards[:, 1], 0.1)[:, None] * tint
    assert_mean(image, (light * passed**panes).mean(axis=0), 1e-9)
    several = Rig(source, 12).render("voronoi", 5, width=PIXELS, height=PIXELS, samples=1200, depth=2)
    assert several.passed > 0 and (several.radiance == image.radiance).all()


def test_a_pane_whose_scales_differ() -> None:
    """It is steep where it was modelled and nearly level where it stands: the angle in the world counts."""
    steep = grid((-2, -9, 2), (4, 0, 0), (0, 18, -4), 4, 1)
    flattened, aside = np.diag([1.0, 0.02, 1.0, 1.0]), np.eye(4)
    flattened[1, 3], aside[0, 3] = 0.9, 100.0
    glass = Material(base_color=(1.0, 1.0, 1.0, 1.0), transmission=1.0, ior=3.0, roughness=0.1)
    lamp = PunctualLight(kind="point", position=(LAMP[0], LAMP[1], LAMP[2]), color=(POWER,) * 3)
    source = scene(
        floor_and(steep),
        [Material(base_color=(*FLOOR, 1.0)), glass],
        [EYE],
        placed=[(0, np.eye(4)), (1, flattened), (1, aside)],
        punctual=[lamp],
    )
    image = Rig(source, 12).render("voronoi", 2, width=PIXELS, height=PIXELS, samples=1200, depth=2)
    light, towards = floor_lit_from(LAMP)
    normal = np.array([0.0, 4.0, 18 * 0.02])
    cosine = np.abs(towards @ normal) / math.sqrt(float(normal @ normal))
    assert_mean(image, (light * passing(cosine, 0.1, 0.25)[:, None]).mean(axis=0))


@pytest.mark.parametrize(("inner", "outer"), [(0.0, 0.12), (0.1, 0.3), (0.0895, 0.09)])
def test_spots_fade_as_gltf_says(inner: float, outer: float) -> None:
    place, half = np.array([0.0, 1.5, 0.0]), HALF
    lamp = PunctualLight(
        kind="spot", position=(0.0, 1.5, 0.0), direction=(0.0, -1.0, 0.0), color=(POWER,) * 3, inner_cone=inner, outer_cone=outer
    )
    source = scene(floor_and(), [Material(base_color=(*FLOOR, 1.0))], [EYE], punctual=[lamp])
    image = Rig(source, 12).render("bounded-radial", 2, width=PIXELS, height=PIXELS, samples=2000, depth=2)
    light, towards = floor_lit_from(place, half)
    scale = 1 / max(0.001, math.cos(inner) - math.cos(outer))
    fade = np.clip((towards[:, 1] - math.cos(outer)) * scale, 0, 1) ** 2
    assert_mean(image, (light * fade[:, None]).mean(axis=0))


@pytest.mark.parametrize(
    ("mode", "alpha", "share"), [(AlphaMode.BLEND, 0.25, 0.25), (AlphaMode.MASK, 0.25, 0.0), (AlphaMode.MASK, 0.75, 1.0)]
)
def test_alpha_thins_what_shines(mode: AlphaMode, alpha: float, share: float) -> None:
    """An emitter that covers a quarter gives a quarter of the light, whether a ray finds it or it is asked for light."""
    lamp = part([(-0.4, 0.6, -0.4), (0.4, 0.6, -0.4), (0.4, 0.6, 0.4), (-0.4, 0.6, 0.4)], [(0, 1, 2), (0, 2, 3)], 1)
    images = []
    for material in (
        Material(base_color=(0.5, 0.5, 0.5, 1.0), emissive=(5.0, 4.0, 3.0)),
        Material(base_color=(0.5, 0.5, 0.5, alpha), emissive=(5.0, 4.0, 3.0), alpha_mode=mode),
    ):
        source = scene(floor_and(lamp), [Material(base_color=(*FLOOR, 1.0)), material], [EYE])
        images.append(Rig(source, 12).render("voronoi", 2, width=PIXELS, height=PIXELS, samples=1600, depth=2))
    assert_mean(images[1], share * images[0].beauty.mean(axis=(0, 1)), 1e-9)
