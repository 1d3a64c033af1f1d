"""Tiles of textures: 120 x 120 pixels of RGBA8, one record each (specs/05-scene-content.md).

    0   4s   "sftx"            6   u32  texture         12   u8  width          14   u8[height, width, 4]
    4   u16  version, 1       10   u16  tile            13   u8  height

Tile k of a texture is column k mod columns of row k div columns, columns = ceil(width / 120); the first row
of pixels is the top of the image, which glTF's v = 0 names. Tiles at the right and lower edge are smaller.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import TEXTURE_TILE_SIDE
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, VERSION = b"sftx", 1


@dataclass(frozen=True, slots=True, eq=False)
class TextureTile:
    texture: int
    tile: int
    pixels: NDArray[np.uint8]
    """u8[height, width, 4], read-only; colours as in the file (sRGB or linear), alpha not multiplied in."""


def encode_tile(texture: int, tile: int, pixels: NDArray[np.uint8]) -> bytes:
    """The payload of pixels u8[h, w, 4], 1 <= h, w <= 120."""
    height, width, channels = pixels.shape
    assert channels == 4 and 1 <= width <= TEXTURE_TILE_SIDE and 1 <= height <= TEXTURE_TILE_SIDE
    fields = struct.pack("<IHBB", texture, tile, width, height)
    return finish([head(KIND, VERSION), fields, np.ascontiguousarray(pixels).tobytes()])


def decode_tile(payload: bytes) -> TextureTile:
    """The tile; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, VERSION, "texture tile")
    texture, tile, width, height = reader.unpack("IHBB")
    sizes = (width, height)
    reader.require(all(1 <= size <= TEXTURE_TILE_SIDE for size in sizes), f"has {width} x {height} pixels")
    pixels = reader.array(np.uint8, height, width, 4)
    reader.end()
    return TextureTile(texture, tile, pixels)
