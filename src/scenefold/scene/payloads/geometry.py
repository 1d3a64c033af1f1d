"""Geometry atoms: about a thousand neighbouring triangles in one record (specs/05-scene-content.md).

    0   4s   "sfga"                    8   u32  prototype      24  f32[nv,3]  positions
    4   u16  version, 1 or 2          12   u32  group              i16[nv,2]  normals, if flag 1
    6   u16  flags                    16   u32  nv, vertices       f32[nv,2]  texture coordinates, if flag 2
                                      20   u32  nt, triangles      f32[nv,2]  a second set of them, if flag 8
                                                                   u16[nv,4]  colours, if flag 16
                                                                   i16[nv,3]  tangents, if flag 32
                                                                   u16[nt,3]  corners
                                                                   u16[nt]    materials; u16[1] if flag 4

Little endian. Positions, normals and tangents are those of the prototype's own space; prototype 0 is the world. Flags from 8 on
came with version 2, which is written for atoms that have one of them: others stay as programs of before expect them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import ATOM_TRIANGLES_MAX, COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head
from scenefold.scene.payloads.vertex_attributes import (
    ATTRIBUTE_FLAGS,
    HAS_COLORS,
    HAS_NORMALS,
    HAS_TANGENTS,
    HAS_UVS,
    HAS_UVS2,
    OLD_FLAGS,
    VertexAttributes,
    decode_colors,
    decode_normals,
    decode_tangents,
    encode_normals,
)

__all__ = [
    "HAS_COLORS", "HAS_NORMALS", "HAS_TANGENTS", "HAS_UVS", "HAS_UVS2", "HEAD_BYTES", "KIND", "NEWEST", "OLDEST", "ONE_MATERIAL", "GeometryAtom",
    "VertexAttributes", "atom_bytes", "decode_atom", "decode_normals", "encode_atom", "encode_normals", "encode_packed", "fits",
    "require_known_flags", "version_for",
]  # fmt: skip

KIND, OLDEST, NEWEST = b"sfga", 1, 2
ONE_MATERIAL = 4
HEAD_BYTES = 24


@dataclass(frozen=True, slots=True, eq=False)
class GeometryAtom:
    """One atom. Arrays are read-only."""

    prototype: int
    group: int
    positions: NDArray[np.float32]
    """f32[nv, 3]"""
    normals: NDArray[np.float32] | None
    """f32[nv, 3] of unit length, or None: flat shading."""
    uvs: NDArray[np.float32] | None
    """f32[nv, 2], or None: no texture reads them."""
    triangles: NDArray[np.uint32]
    """u32[nt, 3] with 1 <= nt <= 1,000; corners in counter-clockwise order seen from outside."""
    materials: NDArray[np.uint16]
    """u16[nt]"""
    uvs2: NDArray[np.float32] | None = None
    """f32[nv, 2], or None: no texture reads a second set."""
    colors: NDArray[np.float32] | None = None
    """f32[nv, 4] within 0 to 1, linear, or None: white."""
    tangents: NDArray[np.float32] | None = None
    """f32[nv, 4]: unit vectors, and +1 or -1: the bitangent is that times normal x tangent. None: they follow from the coordinates."""

    @property
    def flags(self) -> int:
        """Which attributes its vertices have."""
        attributes = {
            HAS_NORMALS: self.normals, HAS_UVS: self.uvs, HAS_UVS2: self.uvs2, HAS_COLORS: self.colors, HAS_TANGENTS: self.tangents,
        }  # fmt: skip
        return sum(flag for flag, array in attributes.items() if array is not None)


def atom_bytes(vertices: int, triangles: int, *, flags: int, one_material: bool) -> int:
    """The size of the payload of an atom whose vertices have the attributes that `flags` name."""
    vertex_bytes = 12 + VertexAttributes.bytes_of_a_vertex(flags)
    return HEAD_BYTES + vertices * vertex_bytes + triangles * 6 + (2 if one_material else 2 * triangles)


def fits(size: int) -> bool:
    return size <= PAYLOAD_BYTES_MAX


def version_for(flags: int) -> int:
    """The oldest version that can say these flags."""
    return OLDEST if flags & ~(OLD_FLAGS | ONE_MATERIAL) == 0 else NEWEST


def require_known_flags(reader: PayloadReader, flags: int) -> None:
    """DamagedData for flags that an atom's version does not have."""
    known = (OLD_FLAGS if reader.version == OLDEST else ATTRIBUTE_FLAGS) | ONE_MATERIAL
    reader.require(flags & ~known == 0, "has unknown flags")


def encode_atom(
    prototype: int,
    group: int,
    positions: NDArray[np.float32],
    normal_codes: NDArray[np.int16] | None,
    uvs: NDArray[np.float32] | None,
    triangles: NDArray[np.uint32],
    materials: NDArray[np.uint16],
) -> bytes:
    """The payload of an atom with no other attributes. Normals come as octahedral codes."""
    return encode_packed(prototype, group, positions, VertexAttributes(normals=normal_codes, uvs=uvs), triangles, materials)


def encode_packed(
    prototype: int,
    group: int,
    positions: NDArray[np.float32],
    attributes: VertexAttributes,
    triangles: NDArray[np.uint32],
    materials: NDArray[np.uint16],
) -> bytes:
    """The payload. Attributes come packed, so that an importer packs them once for all atoms."""
    assert 1 <= len(triangles) == len(materials) <= ATOM_TRIANGLES_MAX
    one_material = bool((materials == materials[0]).all())
    flags = attributes.flags | ONE_MATERIAL * one_material
    return finish(
        [
            head(KIND, version_for(flags)),
            struct.pack("<HIIII", flags, prototype, group, len(positions), len(triangles)),
            np.ascontiguousarray(positions, "<f4").tobytes(),
            *attributes.payload(),
            np.ascontiguousarray(triangles, "<u2").tobytes(),
            np.ascontiguousarray(materials[:1] if one_material else materials, "<u2").tobytes(),
        ]
    )


def decode_atom(payload: bytes) -> GeometryAtom:
    """The atom of a payload; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, OLDEST, "geometry atom", newest=NEWEST)
    flags, prototype, group, vertices, triangle_count = reader.unpack("HIIII")
    require_known_flags(reader, flags)
    reader.require(1 <= triangle_count <= ATOM_TRIANGLES_MAX, f"holds {triangle_count} triangles")
    positions = reader.array("<f4", vertices, 3)
    # NaN fails this comparison too.
    reader.require(bool((np.abs(positions) <= COORDINATE_ABS_MAX).all()), "has a position that is no place")
    packed = VertexAttributes.read(reader, flags, vertices)
    corners = reader.array("<u2", triangle_count, 3)
    reader.require(int(corners.max()) < vertices, "has a corner beyond its vertices")
    materials = reader.array("<u2", 1 if flags & ONE_MATERIAL else triangle_count)
    reader.end()
    triangles = corners.astype(np.uint32)
    normals = None if packed.normals is None else decode_normals(packed.normals)
    colors = None if packed.colors is None else decode_colors(packed.colors)
    tangents = None if packed.tangents is None else decode_tangents(packed.tangents)
    for array in (triangles, normals, colors, tangents):
        if array is not None:
            array.flags.writeable = False
    wearing = np.broadcast_to(materials, triangle_count)
    return GeometryAtom(prototype, group, positions, normals, packed.uvs, triangles, wearing, packed.uvs2, colors, tangents)
