"""If this fails, light is made, lost or led astray on its way through rough walls and solid glass."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import ball, grid, looking, part, room, scene
from scenefold.scene.importers.source import MeshPart
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight
from unit.render import transmission_probe_kernels as probe

Floats = npt.NDArray[np.float64]
WHITE_SKY = (1.0, 1.0, 1.0)
GLASS = Material(transmission=1.0, thickness=1.0, roughness=0.0)
WALL = Material(transmission=1.0, roughness=0.5)


def sphere(material: Material, samples: int = 64, smooth: bool = True, **options: object) -> tuple[Rendered, Floats]:
    """It under an even white sky, and what pixels wholly on it show, f64[n, 3]."""
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=1.05)
    rig = Rig(scene([[ball((0, 0, 0), 1.0, 40, 0, smooth=smooth)]], [material], [eye]), 200)
    image = rig.render("voronoi", 2, width=48, height=48, samples=samples, depth=32, sky=WHITE_SKY, **options)
    seen: Floats = image.beauty[np.isfinite(image.layers["depth"])].astype(np.float64)
    assert image.counters[1:].tolist() == [0, 0]
    return image, seen


def test_a_sphere_of_smooth_glass_is_not_seen_under_an_even_sky() -> None:
    """What its facets keep within for longer than paths are is a few thousandths."""
    _, seen = sphere(GLASS, 256)
    assert seen.mean() == pytest.approx(1.0, abs=2.5e-3)
    assert np.percentile(seen, 5) > 0.97


@pytest.mark.parametrize(("transmission", "roughness"), [(1.0, 0.11), (1.0, 0.5), (0.7, 1.0)])
def test_a_sphere_of_rough_walls_is_not_seen_under_an_even_sky(transmission: float, roughness: float) -> None:
    _, seen = sphere(Material(transmission=transmission, roughness=roughness))
    error = 4 * seen[:, 0].std() / math.sqrt(len(seen))
    assert error < 0.015
    assert seen.mean() == pytest.approx(1.0, abs=0.004 + error)


@pytest.mark.parametrize("roughness", [0.3, 1.0])
def test_a_sphere_of_rough_glass_is_not_seen_under_an_even_sky(roughness: float) -> None:
    """But for what its facets keep within for longer than paths are, as of smooth glass."""
    _, seen = sphere(replace(GLASS, roughness=roughness))
    error = 4 * seen[:, 0].std() / math.sqrt(len(seen))
    assert error < 0.03
    assert seen.mean() == pytest.approx(1.0, abs=0.005 + error)


def test_a_coat_takes_from_what_comes_through_what_it_mirrors() -> None:
    _, seen = sphere(replace(WALL, clearcoat=1.0, clearcoat_roughness=0.2), 128)
    assert seen.mean() == pytest.approx(1.0, abs=0.015)


# A slab seen head on ----------------------------------------------------------------------------------------

THICK, DISTANCE = 0.6, 0.4
TINT, COLOR = np.array([1.0, 0.9, 0.5]), np.array([0.8, 0.5, 0.1])


def box(low: tuple[float, float, float], high: tuple[float, float, float], material: int) -> MeshPart:
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return part(corners, [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))], material)


def test_a_slab_absorbs_by_the_way_through_it() -> None:
    """At normal incidence all bounces between both faces are one geometric series."""
    glass = replace(GLASS, base_color=(*TINT, 1.0), attenuation_distance=DISTANCE, attenuation_color=tuple(COLOR))  # type: ignore[arg-type]
    eye = looking((0, 0, 5), (0, 0, 0), kind="orthographic", ymag=0.2)
    rig = Rig(scene([[box((-2, -2, -THICK / 2), (2, 2, THICK / 2), 0)]], [glass], [eye]), 4)
    image = rig.render("voronoi", 1, width=16, height=16, samples=800, depth=16, sky=WHITE_SKY)
    mirrored, left = 0.04, COLOR ** (THICK / DISTANCE)
    passed = (1 - mirrored) ** 2 * TINT**2 / (1 - mirrored**2 * left**2)
    expected = mirrored + passed * left * (1 + mirrored * left)
    error = 4 * np.sqrt(image.variance.sum(axis=(0, 1))) / 16**2
    assert (error < 2e-3 + 0.01 * expected).all()
    assert (np.abs(image.beauty.mean(axis=(0, 1)) - expected) < error + 1e-3 * expected).all(), (expected, error)


# Lamps behind a pane ----------------------------------------------------------------------------------------

HALF = 0.2
EYE = looking((0.9, 0.3, 2.0), (0, 0, 0), kind="orthographic", ymag=HALF)
PANES = {
    "thin": Material(base_color=(0.9, 0.6, 0.3, 1.0), transmission=0.8, roughness=0.4),
    "rough": Material(base_color=(1.0, 0.8, 0.5, 1.0), transmission=1.0, roughness=1.0, metallic=0.25),
    "solid": Material(base_color=(0.9, 0.6, 0.3, 1.0), transmission=0.8, roughness=0.5, thickness=1.0),
}


def leaving(material: Material, points: Floats, towards: Floats) -> Floats:
    """Value times cosine for light from unit directions f64[n, 3] behind the pane z = 0, towards the camera."""
    way = np.array([0.9, 0.3, 2.0])
    wo = np.ascontiguousarray(np.broadcast_to(way / np.linalg.norm(way), points.shape))
    thin, glass = (0.0, material.transmission) if material.thickness else (material.transmission, 0.0)
    looks = (np.array(material.base_color[:3]), material.metallic, material.roughness**2, (0.04, 0.04, 0.04, 1.0))
    found = probe.evaluations(wo, towards, *looks, thin, glass, material.ior, False)
    return np.asarray(found[:, :3] * found[:, 4:])


def pane_points(count: int) -> Floats:
    """Where the view's pixels lie on the pane, on average alike: f64[count^2, 3]."""
    steps = (np.arange(count) + 0.5) / count * 2 - 1
    right, up, forward = (np.asarray(EYE.matrix).reshape(4, 4)[:3, column] for column in range(3))
    a, b = (axis.ravel() * HALF for axis in np.meshgrid(steps, steps))
    places = np.array([0.9, 0.3, 2.0]) + a[:, None] * right + b[:, None] * up
    return np.asarray(places - forward * (places[:, 2] / forward[2])[:, None])


def assert_mean(image: Rendered, expected: Floats) -> None:
    error = 4 * np.sqrt(image.variance.sum(axis=(0, 1))) / image.beauty[..., 0].size
    assert (error < 0.04 * expected).all(), "too few samples to tell"
    assert (np.abs(image.beauty.mean(axis=(0, 1)) - expected) < error + 3e-3 * expected).all(), (image.beauty.mean(axis=(0, 1)), expected)


@pytest.mark.parametrize("name", PANES)
def test_a_point_of_light_behind_a_pane(name: str) -> None:
    place = np.array([-0.4, -0.1, -0.8])
    lamp = PunctualLight(kind="point", position=(-0.4, -0.1, -0.8), color=(3.0, 3.0, 3.0))
    source = scene([[grid((-2, -2, 0), (4, 0, 0), (0, 4, 0), 2, 0)]], [PANES[name]], [EYE], punctual=[lamp])
    image = Rig(source, 12).render("voronoi", 1, width=8, height=8, samples=400, depth=2)
    points = pane_points(200)
    way = place - points
    squared = (way**2).sum(axis=1)
    light = leaving(PANES[name], points, way / np.sqrt(squared)[:, None]) * (3.0 / squared)[:, None]
    assert_mean(image, light.mean(axis=0))


@pytest.mark.parametrize("name", PANES)
def test_a_glowing_square_behind_a_pane(name: str) -> None:
    """Light samples find it, and so do scattered paths: what both count twice or not at all would show."""
    glowing = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(2.0, 2.0, 2.0))
    square = grid((-0.8, -0.5, -0.7), (0.8, 0, 0), (0, 0.8, 0), 1, 1)
    source = scene([[grid((-2, -2, 0), (4, 0, 0), (0, 4, 0), 2, 0), square]], [PANES[name], glowing], [EYE])
    image = Rig(source, 12).render("voronoi", 1, width=8, height=8, samples=600, depth=2)
    steps = (np.arange(40) + 0.5) / 40 * 0.8
    s, t = (axis.ravel() for axis in np.meshgrid(steps, steps))
    lamps, points = np.stack([s - 0.8, t - 0.5, np.full_like(s, -0.7)], axis=1), pane_points(16)
    way = (lamps[None] - points[:, None]).reshape(-1, 3)
    squared = (way**2).sum(axis=1)
    towards = way / np.sqrt(squared)[:, None]
    shown = leaving(PANES[name], towards, towards) * (2.0 * -towards[:, 2] / squared * 0.8**2 / len(lamps))[:, None]
    assert_mean(image, shown.sum(axis=0) / len(points))


# Bits and evil ----------------------------------------------------------------------------------------------


def test_any_number_of_nodes_gives_the_same_image_of_glass() -> None:
    source = room()
    solid = replace(GLASS, roughness=0.2, attenuation_distance=0.1, attenuation_color=(0.9, 0.6, 0.2), clearcoat=0.5)
    rough = Material(base_color=(0.9, 0.7, 0.3, 1.0), transmission=0.8, roughness=0.4)
    rig = Rig(replace(source, materials=[*source.materials[:5], rough, solid]), 12)
    alone = rig.render(nodes=1, sky=(0.1, 0.15, 0.3), depth=12)
    assert alone.counters[1:].tolist() == [0, 0]
    assert alone.beauty.mean() > 0.1
    for algorithm, nodes in (("voronoi", 3), ("voronoi", 16), ("bounded-radial", 5)):
        together = rig.render(algorithm, nodes, sky=(0.1, 0.15, 0.3), depth=12)
        assert np.array_equal(together.radiance, alone.radiance) and np.array_equal(together.aovs, alone.aovs)
    assert together.passed > 0


@pytest.mark.parametrize(
    "material",
    [
        replace(GLASS, ior=1.0), replace(GLASS, ior=1.0, roughness=1.0), replace(GLASS, ior=1000.0),
        replace(GLASS, attenuation_distance=1e-30, attenuation_color=(0.0, 0.5, 1.0)),
        replace(GLASS, attenuation_distance=1e30, attenuation_color=(0.0, 0.0, 0.0)),
        replace(WALL, ior=1000.0), replace(WALL, ior=1.0, specular=0.0), replace(WALL, base_color=(0.0, 0.0, 0.0, 1.0)),
        replace(GLASS, transmission=1e-6), replace(GLASS, double_sided=True, emissive=(1.0, 1.0, 1.0)),
    ],
    ids=[
        "index 1", "index 1, rough", "index 1000", "black at once", "clear for long", "wall of index 1000", "wall that mirrors nothing",
        "black wall", "hardly any glass", "glowing glass",
    ],
)  # fmt: skip
def test_extreme_glass_gives_sound_images(material: Material) -> None:
    image, seen = sphere(material, 8, smooth=False)
    assert np.isfinite(image.beauty).all()
    assert material.shines or seen.max() < 4.0
    if material.ior == 1.0 and material.transmission == 1.0:
        assert seen.mean() == pytest.approx(1.0, abs=0.01)
    if material.attenuation_distance == 1e-30:
        assert (seen.mean(axis=0)[:2] < 0.2).all() and seen.mean(axis=0)[2] > 0.9, "channel by channel"
