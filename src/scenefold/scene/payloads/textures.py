"""Heads of textures: size, meaning, and where the tiles lie (specs/05-scene-content.md).

A page holds *runs*: a texture with many tiles appears in several runs, each with the locations of the tiles
from `first_tile` on, so that no run outgrows a record.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.limits import TEXTURE_PIXELS_MAX, TEXTURE_SIDE_MAX, TEXTURE_TILE_SIDE
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.scene.payloads.values import Fields, decode_page, encode_pages, shorten

KIND, VERSION = "textures", 1
_RUN_TILES_MAX = 2_500
_TILES_MAX = 1 << 16


@dataclass(frozen=True, slots=True)
class Texture:
    """One image. `tiles` are the locations of its tiles in TEXTURES, row by row."""

    id: int
    name: str
    width: int
    height: int
    srgb: bool
    """Colours are sRGB-coded; alpha never is."""
    has_alpha: bool
    """Some pixel's alpha is below 255."""
    tiles: tuple[Location, ...]
    tile: int = TEXTURE_TILE_SIDE

    @property
    def columns(self) -> int:
        return -(-self.width // self.tile)

    @property
    def rows(self) -> int:
        return -(-self.height // self.tile)

    def tile_at(self, x: int, y: int) -> int:
        """The number of the tile that holds pixel (x, y)."""
        return (y // self.tile) * self.columns + x // self.tile

    def tile_box(self, tile: int) -> tuple[int, int, int, int]:
        """Left, upper, right, lower pixel bounds of a tile (right and lower excluded)."""
        row, column = divmod(tile, self.columns)
        left, upper = column * self.tile, row * self.tile
        return left, upper, min(left + self.tile, self.width), min(upper + self.tile, self.height)


def encode_textures(textures: Sequence[Texture]) -> list[bytes]:
    """Pages in order; `first` of a page counts runs."""
    runs = [_run(texture, first) for texture in textures for first in range(0, len(texture.tiles), _RUN_TILES_MAX)]
    return encode_pages(KIND, VERSION, runs)


def decode_textures(payload: bytes) -> tuple[int, list[Texture]]:
    """The number of a page's first run, and its runs, each as a Texture with only the run's tiles."""
    first, runs = decode_page(payload, KIND, VERSION, _from_fields)
    return first, [texture for _, texture in runs]


def join_textures(payloads: Sequence[bytes]) -> list[Texture]:
    """The textures of all pages, in order; DamagedData if a tile or a texture is missing."""
    textures: list[Texture] = []
    for payload in payloads:
        for first_tile, run in decode_page(payload, KIND, VERSION, _from_fields)[1]:
            begins = first_tile == 0 and run.id == len(textures)
            continues = bool(textures) and run.id == textures[-1].id and first_tile == len(textures[-1].tiles)
            if begins:
                textures.append(run)
            elif continues:
                textures[-1] = _extended(textures[-1], run)
            else:
                raise DamagedData(f"the texture table has texture {run.id}, tile {first_tile}, out of order")
    for texture in textures:
        if len(texture.tiles) != texture.columns * texture.rows:
            raise DamagedData(f"texture {texture.id} has {len(texture.tiles)} tiles, not {texture.columns * texture.rows}")
    return textures


def _extended(texture: Texture, run: Texture) -> Texture:
    return Texture(
        texture.id, texture.name, texture.width, texture.height, texture.srgb, texture.has_alpha,
        texture.tiles + run.tiles,
    )  # fmt: skip


def _run(texture: Texture, first: int) -> dict[str, Any]:
    return {
        "id": texture.id,
        "name": shorten(texture.name),
        "width": texture.width,
        "height": texture.height,
        "srgb": texture.srgb,
        "has_alpha": texture.has_alpha,
        "first_tile": first,
        "locations": b"".join(texture.tiles[first : first + _RUN_TILES_MAX]),
    }


def _from_fields(fields: Fields) -> tuple[int, Texture]:
    locations = fields.raw("locations")
    fields.require(len(locations) % LOCATION_BYTES == 0, "has a torn location")
    width = fields.integer("width", 1, TEXTURE_SIDE_MAX)
    height = fields.integer("height", 1, TEXTURE_SIDE_MAX)
    fields.require(width * height <= TEXTURE_PIXELS_MAX, "has a texture that is too large")
    tiles = range(0, len(locations), LOCATION_BYTES)
    texture = Texture(
        id=fields.integer("id", 0, 2**31),
        name=fields.text("name"),
        width=width,
        height=height,
        srgb=fields.flag("srgb"),
        has_alpha=fields.flag("has_alpha"),
        tiles=tuple(Location(locations[start : start + LOCATION_BYTES]) for start in tiles),
    )
    return fields.integer("first_tile", 0, _TILES_MAX), texture
