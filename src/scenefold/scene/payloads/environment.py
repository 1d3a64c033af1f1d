"""Pages of the environment map: radiance from infinitely far, by direction (specs/05-scene-content.md, *Environment*).

    0   4s   "sfen"           6   u16  width       10   i16  exponent        16   u32  texels of the page
    4   u16  version, 1       8   u16  height      12   u32  first texel     20   f16[texels, 3]

Equirectangular, row by row from the top, which is +Y; the middle of the image is -Z, and +X is to the right of it. A channel's radiance
is its half-precision number times 2^exponent: suns do not fit half precision as they are.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import DamagedData
from scenefold.base.limits import ENVIRONMENT_TEXELS_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, VERSION = b"sfen", 1
TEXELS_OF_A_PAGE = 10_000
_EXPONENT_MAX = 112
"""2^16 times that still fits single precision."""


def _nothing() -> NDArray[np.float16]:
    return np.zeros((0, 3), np.float16)


@dataclass(frozen=True, slots=True, eq=False)
class Environment:
    """The whole map, or none: then both sides are 0."""

    width: int = 0
    height: int = 0
    exponent: int = 0
    texels: NDArray[np.float16] = field(default_factory=_nothing)
    """f16[width * height, 3], finite, at least 0, read-only."""

    def __len__(self) -> int:
        return self.width * self.height

    @property
    def shines(self) -> bool:
        """Whether any of it is not black."""
        return bool((self.texels > 0).any())

    @property
    def radiance(self) -> NDArray[np.float32]:
        """f32[height, width, 3], linear."""
        return (self.texels.astype(np.float32) * np.float32(2.0**self.exponent)).reshape(self.height, self.width, 3)


def encode_environment(environment: Environment) -> list[bytes]:
    """Pages in order; none of none."""
    pages = []
    for first in range(0, len(environment), TEXELS_OF_A_PAGE):
        texels = environment.texels[first : first + TEXELS_OF_A_PAGE]
        fields = struct.pack("<HHhII", environment.width, environment.height, environment.exponent, first, len(texels))
        pages.append(finish([head(KIND, VERSION), fields, texels.astype("<f2").tobytes()]))
    return pages


def join_environment(payloads: Sequence[bytes]) -> Environment:
    """The map that these pages, in order, are; DamagedData if anything is off or missing."""
    pages = []
    form: tuple[int, int, int] | None = None
    expected = 0
    for payload in payloads:
        reader = PayloadReader(payload, KIND, VERSION, "page of the environment map")
        width, height, exponent, first, count = reader.unpack("HHhII")
        form = form or (width, height, exponent)
        reader.require(0 < width * height <= ENVIRONMENT_TEXELS_MAX, f"is of a map of {width} x {height} texels")
        reader.require(0 <= exponent <= _EXPONENT_MAX, "has an odd exponent")
        reader.require((width, height, exponent) == form and first == expected and 0 < count <= TEXELS_OF_A_PAGE, "is out of order")
        texels = reader.array("<f2", count, 3)
        reader.end()
        reader.require(bool((texels >= 0).all() and np.isfinite(texels).all()), "has a texel that is no light")
        pages.append(texels)
        expected += count
    if form is None:
        return Environment()
    if expected != form[0] * form[1]:
        raise DamagedData(f"the environment map has {expected} texels, not {form[0]} x {form[1]}")
    joined = np.concatenate(pages).astype(np.float16)
    joined.flags.writeable = False
    return Environment(*form, joined)
