"""Cuts textures into tiles, one image in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator

from scenefold.base.location import Location
from scenefold.scene.importers.source import SourceTexture
from scenefold.scene.payloads.textures import Texture
from scenefold.scene.payloads.tiles import encode_tile


def texture_head(number: int, texture: SourceTexture, tiles: tuple[Location, ...] = ()) -> Texture:
    """The head that the texture table holds."""
    return Texture(number, texture.name, texture.width, texture.height, texture.srgb, texture.has_alpha, tiles)


def tile_count(texture: SourceTexture) -> int:
    shape = texture_head(0, texture)
    return shape.columns * shape.rows


def tiles_of(number: int, texture: SourceTexture) -> Iterator[bytes]:
    """Payloads of all tiles, row by row."""
    shape, pixels = texture_head(number, texture), texture.pixels()
    for tile in range(shape.columns * shape.rows):
        left, upper, right, lower = shape.tile_box(tile)
        yield encode_tile(number, tile, pixels[upper:lower, left:right])
