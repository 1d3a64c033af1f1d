"""If this fails, a lamp with an emissive texture lights what is around it as if it shone evenly, or nodes disagree about it.

The floor of test_lamps_and_panes.py under a square lamp that is black to one side of x = 0 and white to the other, seen from
between the two; numpy does the integral over the white half.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rig
from render.shapes import grid, looking, part, scene
from render.test_lamps_and_panes import EYE, FLOOR, PIXELS, POWER, Floats, floor_lit_from
from scenefold.scene.importers.source import MeshPart, SourceScene, SourceTexture
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.texture_uses import TextureUse

HEIGHT, REACH = 0.6, 0.4
EMISSIVE = np.array([5.0, 4.0, 3.0])
TEXELS = np.zeros((1, 2, 4), np.uint8)
TEXELS[..., 3], TEXELS[0, 1, :3] = 255, (255, 255, 128)
MEAN = (0.5, 0.5, 64 / 255)
COLOUR = np.array([1.0, 1.0, 128 / 255])


def half_black() -> SourceTexture:
    return SourceTexture("half", 2, 1, False, False, lambda: TEXELS)


def lamp(*, second: bool = False) -> MeshPart:
    """Faces the floor; its coordinates u are those of the texture, or half of them, or stand in the second set."""
    corners = [(-REACH, HEIGHT, -REACH), (REACH, HEIGHT, -REACH), (REACH, HEIGHT, REACH), (-REACH, HEIGHT, REACH)]
    uvs = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    first, other = (0.0 * uvs, np.float32(0.5) * uvs) if second else (uvs, None)
    return replace(part(corners, [(0, 1, 2), (0, 2, 3)], 1, uvs=first), uvs2=other)


def lit_floor(use: TextureUse, *, second: bool = False, mirrored: bool = False) -> SourceScene:
    materials = [
        Material(base_color=(*FLOOR, 1.0)),
        Material(base_color=(0.0, 0.0, 0.0, 1.0), specular=0.0, emissive=tuple(EMISSIVE), emissive_texture=use, emissive_mean=MEAN),
    ]
    floor = [grid((-1, 0, 1), (2, 0, 0), (0, 0, -2), 6, 0)]
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    placed = [(0, np.eye(4)), (1, mirror if mirrored else np.eye(4))]
    return scene([floor, [lamp(second=second)]], materials, [EYE], placed=placed, textures=[half_black()])


@cache
def expected(side: float = 1.0) -> Floats:
    """[PIXELS, 3]: the columns' means from the left, of a lamp that is white where side times x is above 0."""
    cuts, points = 12, 64  # with four times as many points to a side all columns are the same to 2e-5
    total = np.zeros((points, points, 3))
    steps = (np.arange(cuts) + 0.5) / cuts
    for x in steps * REACH * side:
        for z in (2 * steps - 1) * REACH:
            light, towards = floor_lit_from(np.array([x, HEIGHT, z]), side=points)
            total += (light * towards[:, 1:2]).reshape(points, points, 3)
    total *= EMISSIVE * COLOUR / POWER * (2 * REACH * REACH) / cuts**2
    # Seen from above with +Z up, +X is to the left.
    columns: Floats = total.mean(axis=0)[::-1].reshape(PIXELS, -1, 3).mean(axis=1)
    return columns


def assert_columns(image: npt.NDArray[np.float32], variance: npt.NDArray[np.float32], wanted: Floats) -> None:
    error = 4 * np.sqrt(variance.sum(axis=0)) / PIXELS
    assert (error <= 0.02 * wanted).all(), "too few samples to tell"
    assert (np.abs(image.mean(axis=0) - wanted) <= error + 2e-3 * wanted).all(), image.mean(axis=0) / wanted


def test_the_two_sides_are_lit_differently() -> None:
    wanted = expected()
    assert wanted[0, 0] > 1.3 * wanted[-1, 0], "or the texture's mean would do"


PLAIN = TextureUse(0, nearest=True)


@pytest.mark.parametrize(
    ("use", "options", "side"),
    [
        (PLAIN, {}, 1.0),
        pytest.param(TextureUse(0, nearest=True, transform=(-1.0, 0.0, 1.0, 0.0, 1.0, 0.0)), {}, -1.0, marks=pytest.mark.long),
        (TextureUse(0, 1, nearest=True, transform=(2.0, 0.0, 0.0, 0.0, 1.0, 0.0)), {"second": True}, 1.0),
        pytest.param(PLAIN, {"mirrored": True}, -1.0, marks=pytest.mark.long),
    ],
    ids=["plain", "transformed", "second coordinates", "mirrored"],
)
def test_a_half_black_lamp_lights_the_floor_as_the_integral_says(use: TextureUse, options: dict[str, bool], side: float) -> None:
    rig = Rig(lit_floor(use, **options), 12)
    image = rig.render("voronoi", 1, width=PIXELS, height=PIXELS, samples=8000, depth=2)
    assert_columns(image.beauty, image.variance, expected(side))


def test_who_does_not_hold_the_lamp_finds_the_same() -> None:
    """On a long floor, of which a part far from the lamp is in view as well."""
    source = lit_floor(PLAIN)
    floor = [grid((-1, 0, 1), (12, 0, 0), (0, 0, -2), 10, 0)]
    rig = Rig(replace(source, meshes=[floor, source.meshes[1]], cameras=[looking((5, 4, 6), (5, 0, 0))]), 12)
    asked = {"width": 24, "height": 12, "samples": 64, "depth": 4}
    job = rig.job("voronoi", 4, **asked)
    shining = set(rig.tables.lights.groups.tolist())
    held = [rig.held(job.partition, me) for me in range(4)]
    without = [one for one in held if shining.isdisjoint(group.group for group in one.groups)]
    assert without, "all nodes hold the lamp: nothing is tested"
    assert all((one.arrays.textures[0] >= 0).all() for one in without), "its texture is everywhere"
    alone, together = rig.render("voronoi", 1, **asked), rig.run(job)
    assert together.passed > 0 and np.array_equal(alone.radiance, together.radiance)
    assert alone.beauty[:, 12:].max() > 0
