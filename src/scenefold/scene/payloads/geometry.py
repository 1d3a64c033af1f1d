"""Geometry atoms: about a thousand neighbouring triangles in one record (specs/05-scene-content.md).

    0   4s   "sfga"                    8   u32  prototype      24  f32[nv,3]  positions
    4   u16  version, 1               12   u32  group              i16[nv,2]  normals, if flag 1
    6   u16  flags                    16   u32  nv, vertices       f32[nv,2]  texture coordinates, if flag 2
                                      20   u32  nt, triangles      u16[nt,3]  corners
                                                                   u16[nt]    materials; u16[1] if flag 4

Little endian. Positions and normals are those of the prototype's own space; prototype 0 is the world.
A normal is an octahedral code of 2 x 16 signed bits (4 bytes instead of 12, wrong by at most 0.005 degrees):
decoding uses + - x / and the square root only, so every node gets the same bits.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import ATOM_TRIANGLES_MAX, COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, VERSION = b"sfga", 1
HAS_NORMALS, HAS_UVS, ONE_MATERIAL = 1, 2, 4
_FLAGS = HAS_NORMALS | HAS_UVS | ONE_MATERIAL
HEAD_BYTES = 24
_OCTAHEDRON = np.float32(32_767)


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
    """f32[nv, 2], or None: no texture is used."""
    triangles: NDArray[np.uint32]
    """u32[nt, 3] with 1 <= nt <= 1,000; corners in counter-clockwise order seen from outside."""
    materials: NDArray[np.uint16]
    """u16[nt]"""


def encode_normals(normals: NDArray[np.float64]) -> NDArray[np.int16]:
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


def atom_bytes(vertices: int, triangles: int, *, normals: bool, uvs: bool, one_material: bool) -> int:
    """The size of the payload of such an atom."""
    vertex_bytes = 12 + 4 * normals + 8 * uvs
    return HEAD_BYTES + vertices * vertex_bytes + triangles * 6 + (2 if one_material else 2 * triangles)


def fits(size: int) -> bool:
    return size <= PAYLOAD_BYTES_MAX


def encode_atom(
    prototype: int,
    group: int,
    positions: NDArray[np.float32],
    normal_codes: NDArray[np.int16] | None,
    uvs: NDArray[np.float32] | None,
    triangles: NDArray[np.uint32],
    materials: NDArray[np.uint16],
) -> bytes:
    """The payload. Normals come as octahedral codes, so that an importer packs them once for all atoms."""
    assert 1 <= len(triangles) == len(materials) <= ATOM_TRIANGLES_MAX
    one_material = bool((materials == materials[0]).all())
    flags = HAS_NORMALS * (normal_codes is not None) | HAS_UVS * (uvs is not None) | ONE_MATERIAL * one_material
    parts = [
        head(KIND, VERSION),
        struct.pack("<HIIII", flags, prototype, group, len(positions), len(triangles)),
        np.ascontiguousarray(positions, "<f4").tobytes(),
    ]
    if normal_codes is not None:
        parts.append(np.ascontiguousarray(normal_codes, "<i2").tobytes())
    if uvs is not None:
        parts.append(np.ascontiguousarray(uvs, "<f4").tobytes())
    parts.append(np.ascontiguousarray(triangles, "<u2").tobytes())
    parts.append(np.ascontiguousarray(materials[:1] if one_material else materials, "<u2").tobytes())
    return finish(parts)


def decode_atom(payload: bytes) -> GeometryAtom:
    """The atom of a payload; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, VERSION, "geometry atom")
    flags, prototype, group, vertices, triangle_count = reader.unpack("HIIII")
    reader.require(flags & ~_FLAGS == 0, "has unknown flags")
    reader.require(1 <= triangle_count <= ATOM_TRIANGLES_MAX, f"holds {triangle_count} triangles")
    positions = reader.array("<f4", vertices, 3)
    # NaN fails this comparison too.
    reader.require(bool((np.abs(positions) <= COORDINATE_ABS_MAX).all()), "has a position that is no place")
    normals = decode_normals(reader.array("<i2", vertices, 2)) if flags & HAS_NORMALS else None
    uvs = reader.array("<f4", vertices, 2) if flags & HAS_UVS else None
    reader.require(uvs is None or bool(np.isfinite(uvs).all()), "has an infinite texture coordinate")
    corners = reader.array("<u2", triangle_count, 3)
    reader.require(int(corners.max()) < vertices, "has a corner beyond its vertices")
    materials = reader.array("<u2", 1 if flags & ONE_MATERIAL else triangle_count)
    reader.end()
    triangles = corners.astype(np.uint32)
    triangles.flags.writeable = False
    if normals is not None:
        normals.flags.writeable = False
    return GeometryAtom(prototype, group, positions, normals, uvs, triangles, np.broadcast_to(materials, triangle_count))
