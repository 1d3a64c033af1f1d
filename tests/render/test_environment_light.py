"""If this fails, what an environment map lights is not lit by it, or not the same on every node."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import ball, grid, looking, room, scene
from scenefold.render.kit.rig import Rig as AnyRig
from scenefold.render.renderers.mitsuba import library
from scenefold.render.renderers.mitsuba.renderer import MitsubaRenderer
from scenefold.scene.importers.environments import environment_of
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.payloads.materials import Material

Pixels = npt.NDArray[np.float32]
MATERIALS = [
    Material(base_color=(0.8, 0.6, 0.4, 1.0)),
    Material(base_color=(0.9, 0.9, 0.9, 1.0), metallic=1.0, roughness=0.2),
    Material(base_color=(0.5, 0.5, 0.5, 1.0), roughness=0.7),
]


def under(radiance: Pixels) -> SourceScene:
    """Two balls on a floor."""
    things = [ball((-0.6, 0.0, 0.0), 0.5, 10, 0, smooth=True), ball((0.6, 0.0, 0.0), 0.5, 10, 1, smooth=True)]
    floor = grid((-2, -0.5, 2), (4, 0, 0), (0, 0, -4), 2, 2)
    plain = scene([[*things, floor]], MATERIALS, [looking((0.0, 1.2, 4.0), (0.0, 0.0, 0.0), yfov=0.7)])
    return replace(plain, environment=environment_of(radiance)[0])


def constant(*color: float) -> Pixels:
    return np.broadcast_to(np.float32(color), (16, 32, 3)).copy()


def sunny() -> Pixels:
    """A blue sky, brown ground, and a small sun that is behind the camera and to its right."""
    height, width = 32, 64
    texels = np.empty((height, width, 3), np.float32)
    texels[: height // 2], texels[height // 2 :] = (0.3, 0.5, 0.9), (0.2, 0.15, 0.1)
    texels[8:10, 52:54] = (300.0, 280.0, 220.0)
    return texels


def means_agree(left: Rendered, right: Rendered, within: float) -> None:
    """Of the image, and of its quarters."""
    for rows in (slice(0, 12), slice(12, 24)):
        for columns in (slice(0, 12), slice(12, 24)):
            one, other = left.beauty[rows, columns], right.beauty[rows, columns]
            noise = np.sqrt((left.variance[rows, columns] + right.variance[rows, columns]).astype(np.float64).sum(axis=(0, 1))) / 144
            gap = np.abs(one.mean(axis=(0, 1)) - other.mean(axis=(0, 1)))
            assert (gap < 4 * noise + within * other.mean(axis=(0, 1))).all(), (gap, noise)


def test_a_constant_map_is_a_constant_sky() -> None:
    rig = Rig(under(constant(0.5, 0.25, 1.0)))
    by_map, by_sky = rig.render(samples=256), Rig(under(constant(0.0, 0.0, 0.0))).render(samples=256, sky=(0.5, 0.25, 1.0))
    means_agree(by_map, by_sky, 0.002)
    assert by_map.counters[1] == 0
    # A sky that is asked for takes the map's place, to the bit.
    assert np.array_equal(
        rig.render(sky=(0.5, 0.25, 1.0)).radiance, Rig(under(constant(1.0, 1.0, 1.0))).render(sky=(0.5, 0.25, 1.0)).radiance
    )


def test_a_white_ball_disappears_in_a_white_map() -> None:
    source = scene([[ball((0, 0, 0), 1.0, 16, 0, smooth=True)]], [Material(metallic=1.0, roughness=0.0)], [looking((0, 0, 4), (0, 0, 0))])
    image = Rig(replace(source, environment=environment_of(constant(1.0, 1.0, 1.0))[0])).render(samples=64)
    assert np.abs(image.beauty - 1.0).max() < 0.05 and abs(image.beauty.mean() - 1.0) < 2e-3


@pytest.mark.parametrize("nodes", [2, 5])
def test_equal_bits_on_any_number_of_nodes(nodes: int) -> None:
    rig = Rig(replace(room(), environment=environment_of(sunny())[0]), 12)
    alone = rig.render(environment_rotation=20.0)
    for algorithm in ("voronoi", "bounded-radial"):
        together = rig.render(algorithm, nodes, environment_rotation=20.0)
        assert np.array_equal(alone.radiance, together.radiance) and np.array_equal(alone.aovs, together.aovs)
    assert not np.array_equal(alone.radiance, rig.render(environment_rotation=21.0).radiance)


def test_what_is_no_light_gives_a_finite_image() -> None:
    radiance = sunny()
    radiance[3, 5:9], radiance[4, 4] = np.nan, np.inf
    source = replace(under(radiance))
    image = Rig(source).render(samples=64)
    assert np.isfinite(image.beauty).all() and image.counters[1] == 0 and image.beauty.mean() > 0.1
    black = Rig(under(constant(0.0, 0.0, 0.0))).render()
    assert not black.beauty.any()


def test_a_sun_casts_little_noise() -> None:
    """Drawn by the map: by chance alone the sun, a thousandth of the sphere, would be missed by most of these paths."""
    image = Rig(under(sunny())).render(samples=64)
    error = np.sqrt(image.variance[18:]) / image.beauty[18:]
    assert float(np.median(error)) < 0.2


@pytest.mark.timeout(300)
@pytest.mark.skipif(not library.is_installed() or not library.llvm_library(), reason="mitsuba, or its LLVM, is not installed")
def test_mitsuba_shows_the_same() -> None:
    source = under(sunny())
    for degrees in (0.0, 130.0):
        ours = Rig(source).render(samples=256, environment_rotation=degrees, mips=False)
        theirs = AnyRig(source, MitsubaRenderer()).render(samples=256, environment_rotation=degrees)
        means_agree(ours, theirs, 0.01)
