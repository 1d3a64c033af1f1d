"""How a material reads one of its textures: which image, at which coordinates, and what lies outside of it.

A use stands in a page of materials (materials.py) as the list

    [texture, uv set, wrap s, wrap t, nearest, m00, m01, m02, m10, m11, m12, minify]

Coordinates are those of the vertices, v running down from the image's first row. The transform is applied to them where the
texture is read: u' = m00 u + m01 v + m02, v' = m10 u + m11 v + m12. Floats without a unit; one is a whole image.
The last entry is left out where it is the usual one, as all pages once had it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from scenefold.scene.payloads.values import Fields

Transform = tuple[float, float, float, float, float, float]
IDENTITY: Transform = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
UV_SETS = 2
"""A vertex has at most so many sets of texture coordinates."""
TEXTURES_MAX = 2**31
TRANSFORM_MAX = 1e9
"""Of a transform's numbers: beyond it, nothing of a coordinate is left."""
_LENGTH = 11
"""Without the minification."""


class Wrap(IntEnum):
    """What lies outside 0 to 1 of texture coordinates."""

    REPEAT = 0
    CLAMP = 1
    MIRROR = 2


class Minify(IntEnum):
    """How a texture is read where its texels are smaller than the pixels (glTF's minFilter): from which levels, and how within them."""

    FINEST = 0
    """The image itself, read as where it is magnified."""
    NEAREST_OF_NEAREST = 1
    """The nearest texel of the nearest level."""
    LINEAR_OF_NEAREST = 2
    """Between four texels of the nearest level."""
    NEAREST_BETWEEN = 3
    """Between the nearest texels of two levels."""
    LINEAR_BETWEEN = 4
    """Between four texels of each of two levels: trilinear."""


@dataclass(frozen=True, slots=True)
class TextureUse:
    texture: int
    """Its number in the texture table."""
    uv_set: int = 0
    """0 or 1: which of the vertices' coordinates."""
    wrap_s: Wrap = Wrap.REPEAT
    wrap_t: Wrap = Wrap.REPEAT
    nearest: bool = False
    transform: Transform = IDENTITY
    """Row by row."""
    minify: Minify = Minify.LINEAR_BETWEEN

    def row(self) -> list[Any]:
        """Plain values, as a page has them."""
        place = [self.texture, self.uv_set, int(self.wrap_s), int(self.wrap_t), self.nearest]
        last = [] if self.minify is Minify.LINEAR_BETWEEN else [int(self.minify)]
        return [*place, *(float(value) for value in self.transform), *last]


def use_of_row(fields: Fields, key: str) -> TextureUse:
    """The use that a page has under this key; DamagedData if it is none."""
    row = fields.sequence(key, _LENGTH + 1)
    fields.require(len(row) in (_LENGTH, _LENGTH + 1), f"has an odd {key!r}")
    minify = row[_LENGTH] if len(row) > _LENGTH else int(Minify.LINEAR_BETWEEN)
    row = row[:_LENGTH]
    bounds = (TEXTURES_MAX, UV_SETS - 1, len(Wrap) - 1, len(Wrap) - 1)
    whole = all(type(value) is int and 0 <= value <= high for value, high in zip(row, bounds, strict=False))
    moves = all(type(value) is float and math.isfinite(value) and abs(value) <= TRANSFORM_MAX for value in row[5:])
    levels = type(minify) is int and 0 <= minify < len(Minify)
    fields.require(whole and type(row[4]) is bool and moves and levels, f"has an odd {key!r}")
    m00, m01, m02, m10, m11, m12 = row[5:]
    return TextureUse(row[0], row[1], Wrap(row[2]), Wrap(row[3]), row[4], (m00, m01, m02, m10, m11, m12), Minify(minify))
