"""How images and their coarser levels lie in `SceneArrays.texels`, and how levels are made (specs/09-renderer-contract.md)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from scenefold.render.arrays import I64, U8, TextureColumn
from scenefold.render.mip_kernels import fill_level, level_sizes, level_tables
from scenefold.render.setup_kernels import linear_of_srgb
from scenefold.scene.payloads.materials import AlphaMode
from scenefold.scene.payloads.texture_uses import Minify
from scenefold.scene.tables import SceneTables


def texture_rows(tables: SceneTables, held: Iterable[int]) -> tuple[I64, int]:
    """`SceneArrays.textures` for the held images, in this order, each with its coarser levels behind it if any use reads them; and the bytes of `texels`."""
    rows = np.zeros((len(tables.textures), TextureColumn.WIDTH), np.int64)
    rows[:, TextureColumn.OFFSET] = -1
    minified = {use.texture for material in tables.materials for _, use in material.uses() if use.minify is not Minify.FINEST}
    offset = 0
    for number in held:
        texture = tables.textures[number]
        sizes = level_sizes(texture.width, texture.height)
        if number not in minified:
            sizes = sizes[:1]
        rows[number] = offset, texture.width, texture.height, int(texture.srgb), len(sizes)
        offset += sum(width * height * 4 for width, height in sizes)
    return rows, offset


def levels_of(tables: SceneTables, number: int, rows: I64, texels: U8) -> list[U8]:
    """u8[height, width, 4] of each level of a held image, as views of `texels`, the finest first."""
    texture, (offset, levels) = tables.textures[number], rows[number][[TextureColumn.OFFSET, TextureColumn.LEVELS]]
    found = []
    for width, height in level_sizes(texture.width, texture.height)[:levels]:
        end = offset + width * height * 4
        found.append(texels[offset:end].reshape(height, width, 4))
        offset = end
    return found


def fill_levels(tables: SceneTables, number: int, levels: Sequence[U8], *, by_alpha: bool) -> None:
    """Make each level of an image of the one before it. `by_alpha`: whether it is among the `hiding_textures`."""
    values, codes = level_tables(linear_of_srgb(), tables.textures[number].srgb)
    for finer, coarser in pairwise(levels):
        fill_level(finer, coarser, values, codes, by_alpha)


def hiding_textures(tables: SceneTables) -> frozenset[int]:
    """Those whose alpha says how much is seen of their colours; of all others it is a number, or nothing."""
    return frozenset(
        material.base_color_texture.texture
        for material in tables.materials
        if material.alpha_mode != AlphaMode.OPAQUE and material.base_color_texture is not None
    )
