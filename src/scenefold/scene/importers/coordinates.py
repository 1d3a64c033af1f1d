"""Which texture coordinates a material's textures read, and what of their transforms goes into the vertices.

A file may have many sets of coordinates and a transform for each texture; a vertex here has two sets at most. Where all
textures of a material that read a set transform it alike, the transform is baked into the vertices; only where they differ does
each texture's use keep its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.payloads.materials import TEXTURE_SLOTS, Material
from scenefold.scene.payloads.texture_uses import IDENTITY, UV_SETS, Minify, TextureUse, Transform, Wrap


@dataclass(frozen=True, slots=True)
class Reading:
    """How a file says that a texture is read."""

    texture: int
    uv_set: int = 0
    """Of the file's sets."""
    wrap_s: Wrap = Wrap.REPEAT
    wrap_t: Wrap = Wrap.REPEAT
    nearest: bool = False
    transform: Transform = IDENTITY
    minify: Minify = Minify.LINEAR_BETWEEN


@dataclass(frozen=True, slots=True)
class CoordinateSet:
    """A set of the file, and the transform that is baked into it."""

    number: int
    transform: Transform = IDENTITY

    def apply(self, uvs: NDArray[np.float32]) -> NDArray[np.float32]:
        """float32[nv, 2] of the file's float32[nv, 2]; in f64, rounded once."""
        if self.transform == IDENTITY:
            return uvs
        m00, m01, m02, m10, m11, m12 = self.transform
        u, v = uvs[:, 0].astype(np.float64), uvs[:, 1].astype(np.float64)
        # What is not finite is mended by who reads the mesh.
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([u * m00 + v * m01 + m02, u * m10 + v * m11 + m12], axis=1).astype(np.float32)


def settle(readings: Mapping[str, Reading]) -> tuple[tuple[CoordinateSet, ...], dict[str, TextureUse]]:
    """The sets that vertices get (at most two, that of the base colour first), and each slot's use.

    Slots that read a third set have none.
    """
    slots = [slot for slot in TEXTURE_SLOTS if slot in readings]
    numbers = list(dict.fromkeys(readings[slot].uv_set for slot in slots))[:UV_SETS]
    sets = []
    for number in numbers:
        transforms = {readings[slot].transform for slot in slots if readings[slot].uv_set == number}
        sets.append(CoordinateSet(number, transforms.pop() if len(transforms) == 1 else IDENTITY))
    uses = {}
    for slot in slots:
        reading = readings[slot]
        if reading.uv_set in numbers:
            place = numbers.index(reading.uv_set)
            transform = IDENTITY if reading.transform == sets[place].transform else reading.transform
            uses[slot] = TextureUse(reading.texture, place, reading.wrap_s, reading.wrap_t, reading.nearest, transform, reading.minify)
    return tuple(sets), uses


def without_common_transform(material: Material) -> tuple[Material, CoordinateSet]:
    """A material whose textures all read set 0, and the set with the transform baked in that all have, if they have one."""
    transforms = {use.transform for _, use in material.uses()}
    if len(transforms) != 1:
        return material, CoordinateSet(0)
    bare: dict[str, Any] = {f"{slot}_texture": replace(use, transform=IDENTITY) for slot, use in material.uses()}
    return replace(material, **bare), CoordinateSet(0, transforms.pop())
