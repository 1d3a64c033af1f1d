"""What the vertices of a geometry atom have beside their positions, packed as its bytes are (geometry.py).

A normal is an octahedral code of 2 x 16 signed bits (4 bytes instead of 12, wrong by at most 0.005 degrees): decoding uses
+ - x / and the square root only, so every node gets the same bits. A tangent is such a code and +1 or -1: the way in which the
bitangent goes, as glTF has it. A colour is linear red, green, blue and alpha of 16 bits each, 65,535 being 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.payloads.binary import PayloadReader

HAS_NORMALS, HAS_UVS, HAS_UVS2, HAS_COLORS, HAS_TANGENTS = 1, 2, 8, 16, 32
"""Flags of an atom, and of a group; 4 says something else of an atom."""
OLD_FLAGS = HAS_NORMALS | HAS_UVS
"""Those that version 1 of atoms and of pages of groups knows."""
ATTRIBUTE_FLAGS = OLD_FLAGS | HAS_UVS2 | HAS_COLORS | HAS_TANGENTS
_LAYOUT = {
    "normals": (HAS_NORMALS, "<i2", 2),
    "uvs": (HAS_UVS, "<f4", 2),
    "uvs2": (HAS_UVS2, "<f4", 2),
    "colors": (HAS_COLORS, "<u2", 4),
    "tangents": (HAS_TANGENTS, "<i2", 3),
}
"""Flag, type and width of each, in the order of the bytes."""
_OCTAHEDRON = np.float32(32_767)
_ONE = np.float32(65_535)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VertexAttributes:
    normals: NDArray[np.int16] | None = None
    """i16[nv, 2], octahedral codes."""
    uvs: NDArray[np.float32] | None = None
    """f32[nv, 2]"""
    uvs2: NDArray[np.float32] | None = None
    """f32[nv, 2]"""
    colors: NDArray[np.uint16] | None = None
    """u16[nv, 4]"""
    tangents: NDArray[np.int16] | None = None
    """i16[nv, 3], octahedral codes and signs."""

    @classmethod
    def read(cls, reader: PayloadReader, flags: int, vertices: int) -> VertexAttributes:
        """Those that the flags name, as views; DamagedData for what is no attribute."""
        found: dict[str, Any] = {name: reader.array(kind, vertices, width) for name, (flag, kind, width) in _LAYOUT.items() if flags & flag}
        for name in ("uvs", "uvs2"):
            reader.require(name not in found or bool(np.isfinite(found[name]).all()), "has an infinite texture coordinate")
        signs = np.abs(found["tangents"][:, 2]) if "tangents" in found else np.ones(1)
        reader.require(bool((signs == 1).all()), "has a tangent of no side")
        return cls(**found)

    @property
    def flags(self) -> int:
        """Which there are."""
        return sum(flag for name, (flag, _, _) in _LAYOUT.items() if getattr(self, name) is not None)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Those that there are, by name."""
        found = {name: getattr(self, name) for name in _LAYOUT}
        return {name: array for name, array in found.items() if array is not None}

    def taken(self, numbers: NDArray[Any]) -> VertexAttributes:
        """Of some of the vertices, by number or by a mask."""
        return VertexAttributes(**{name: array[numbers] for name, array in self.arrays().items()})

    def payload(self) -> list[bytes]:
        """The bytes of each, in order."""
        return [np.ascontiguousarray(array, _LAYOUT[name][1]).tobytes() for name, array in self.arrays().items()]

    @staticmethod
    def bytes_of_a_vertex(flags: int) -> int:
        """How much a vertex takes beside its position."""
        return sum(np.dtype(kind).itemsize * width for flag, kind, width in _LAYOUT.values() if flags & flag)

    @staticmethod
    def empty(flags: int, vertices: int) -> VertexAttributes:
        """Zeros."""
        return VertexAttributes(
            **{name: np.zeros((vertices, width), kind) for name, (flag, kind, width) in _LAYOUT.items() if flags & flag}
        )

    @staticmethod
    def joined(pieces: Sequence[VertexAttributes]) -> VertexAttributes:
        """Of the vertices of all pieces, in order; all have the same attributes."""
        return VertexAttributes(**{name: np.concatenate([piece.arrays()[name] for piece in pieces]) for name in pieces[0].arrays()})


def encode_normals(normals: NDArray[np.floating]) -> NDArray[np.int16]:
    """Octahedral codes i16[n, 2] of vectors [n, 3] of any length but 0."""
    vectors = np.asarray(normals, np.float64)
    sums = np.abs(vectors).sum(axis=1)
    flat = vectors[:, :2] / sums[:, None]
    folded = (1.0 - np.abs(flat[:, ::-1])) * np.where(flat < 0.0, -1.0, 1.0)
    flat = np.where(vectors[:, 2:] < 0.0, folded, flat)
    codes: NDArray[np.int16] = np.rint(np.clip(flat, -1.0, 1.0) * 32_767.0).astype(np.int16)
    return codes


def decode_normals(codes: NDArray[np.int16]) -> NDArray[np.float32]:
    """Unit vectors f32[n, 3] of octahedral codes."""
    flat = codes.astype(np.float32) / _OCTAHEDRON
    vectors = np.empty((len(codes), 3), np.float32)
    vectors[:, 2] = np.float32(1) - np.abs(flat[:, 0]) - np.abs(flat[:, 1])
    fold = np.maximum(-vectors[:, 2], np.float32(0))
    vectors[:, :2] = flat - np.where(flat < 0, -fold[:, None], fold[:, None])
    squares = vectors * vectors
    lengths = np.sqrt(squares[:, 0] + squares[:, 1] + squares[:, 2])
    vectors /= lengths[:, None]
    return vectors


def encode_tangents(tangents: NDArray[np.floating]) -> NDArray[np.int16]:
    """i16[n, 3] of [n, 4]: vectors of any length but 0, and a number of which the sign counts."""
    codes = np.empty((len(tangents), 3), np.int16)
    codes[:, :2] = encode_normals(tangents[:, :3])
    codes[:, 2] = np.where(tangents[:, 3] < 0, -1, 1)
    return codes


def decode_tangents(codes: NDArray[np.int16]) -> NDArray[np.float32]:
    """f32[n, 4]: unit vectors, and +1 or -1."""
    return np.concatenate([decode_normals(codes[:, :2]), codes[:, 2:].astype(np.float32)], axis=1)


def encode_colors(colors: NDArray[np.floating]) -> NDArray[np.uint16]:
    """u16[n, 4] of linear red, green, blue and alpha [n, 4] within 0 to 1."""
    codes: NDArray[np.uint16] = np.rint(np.asarray(colors, np.float64) * 65_535.0).astype(np.uint16)
    return codes


def decode_colors(codes: NDArray[np.uint16]) -> NDArray[np.float32]:
    """f32[n, 4] within 0 to 1."""
    return codes.astype(np.float32) / _ONE
