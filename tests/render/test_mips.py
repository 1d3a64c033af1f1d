"""If this fails, far textures shimmer at few samples, get another brightness than near ones, or differ between nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from render.rig import Rendered, Rig
from render.shapes import grid, looking, scene
from scenefold.scene.importers.source import SourceTexture
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.texture_uses import Minify, TextureUse

WIDTH, HEIGHT = 96, 54
TO_THE_HORIZON = looking((0, 1, 0), (0, 0.7, -3))


def board(width: int, height: int, squares: int) -> SourceTexture:
    """Black and white squares."""
    rows, columns = np.mgrid[0:height, 0:width]
    texels: npt.NDArray[np.uint8] = np.full((height, width, 4), 255, np.uint8)
    texels[((columns * squares // width) + (rows * squares // height)) % 2 == 0, :3] = 0
    return SourceTexture("board", width, height, True, False, lambda: texels)


def plane(use: TextureUse, eye: Camera, texture: SourceTexture) -> Rig:
    floor = grid((-200, 0, 1), (400, 0, 0), (0, 0, -400), 12, 0, textured=True)
    assert floor.uvs is not None
    floor = replace(floor, uvs=floor.uvs * np.float32(200.0))
    return Rig(scene([[floor]], [Material(base_color_texture=use, unlit=True)], [eye], textures=[texture]), 40)


def shown(rig: Rig, nodes: int = 1, **options: object) -> Rendered:
    return rig.render("voronoi", nodes, width=WIDTH, height=HEIGHT, **options)  # type: ignore[arg-type]


def far_part(image: Rendered) -> npt.NDArray[np.float64]:
    """The rows below the horizon, where a pixel sees many squares."""
    return np.asarray(image.beauty, np.float64)[21:26].mean(axis=-1)


@pytest.mark.parametrize("size", [(64, 64), (60, 44)])
def test_a_far_board_is_greyer_at_one_sample(size: tuple[int, int]) -> None:
    rig = plane(TextureUse(0), TO_THE_HORIZON, board(*size, 4))
    filtered, sharp = far_part(shown(rig, samples=1)), far_part(shown(rig, samples=1, mips=False))
    assert filtered.var() < 0.85 * sharp.var()
    many = far_part(shown(rig, samples=256, mips=False))
    assert abs(filtered.mean() - many.mean()) < 0.05 * many.mean()
    assert abs(far_part(shown(rig, samples=256)).mean() - many.mean()) < 0.02 * many.mean()


@pytest.mark.parametrize("minify", list(Minify))
def test_any_nodes_give_the_same_bits(minify: Minify) -> None:
    rig = plane(TextureUse(0, minify=minify), TO_THE_HORIZON, board(64, 64, 4))
    alone = shown(rig, samples=2)
    assert np.array_equal(alone.radiance, shown(rig, 3, samples=2).radiance)
    same = np.array_equal(alone.radiance, shown(rig, samples=2, mips=False).radiance)
    assert same == (minify is Minify.FINEST)


def test_what_is_magnified_has_the_bits_of_the_finest_level() -> None:
    near = looking((0, 1, 0), (0, 0, 0), kind="orthographic", ymag=0.02)
    rig = plane(TextureUse(0), near, board(64, 64, 4))
    assert np.array_equal(shown(rig, samples=2).radiance, shown(rig, samples=2, mips=False).radiance)
