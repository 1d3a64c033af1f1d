"""Geometry atoms cut by triangles, and put together again bit for bit (specs/04-records.md, Split records). Pure.

A piece has the vertices of its triangles and the numbers that they had, so that nothing is computed on the way: not a bit of the
coordinates changes. Triangles stay in their order, since the light table names them by it.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scenefold.base.errors import DamagedData
from scenefold.scene.payloads.binary import PayloadReader, head
from scenefold.scene.payloads.geometry import KIND, NEWEST, OLDEST, ONE_MATERIAL, VertexAttributes, decode_atom

_NUMBERS = struct.Struct(">HH")
_VERTICES_MAX = 65_535


@dataclass(frozen=True, slots=True, eq=False)
class _Bare:
    """An atom as its bytes are, nothing decoded: arrays of little-endian numbers."""

    version: int
    flags: int
    prototype: int
    group: int
    positions: NDArray[np.float32]
    attributes: VertexAttributes
    corners: NDArray[np.uint16]
    materials: NDArray[np.uint16]

    @classmethod
    def read(cls, payload: bytes) -> _Bare:
        """DamagedData if it is no atom."""
        decode_atom(payload)
        reader = PayloadReader(payload, KIND, OLDEST, "geometry atom", newest=NEWEST)
        flags, prototype, group, vertices, triangles = reader.unpack("HIIII")
        positions = reader.array("<f4", vertices, 3)
        attributes = VertexAttributes.read(reader, flags, vertices)
        corners = reader.array("<u2", triangles, 3)
        materials = reader.array("<u2", 1 if flags & ONE_MATERIAL else triangles)
        return cls(reader.version, flags, prototype, group, positions, attributes, corners, materials)

    def bytes(self) -> bytes:
        counts = struct.pack("<HIIII", self.flags, self.prototype, self.group, len(self.positions), len(self.corners))
        ends = (self.corners.tobytes(), self.materials.tobytes())
        # How long it is, is looked at by who knows how long it was.
        return b"".join([head(KIND, self.version), counts, self.positions.tobytes(), *self.attributes.payload(), *ends])

    def piece(self, first: int, last: int) -> tuple[NDArray[np.int64], _Bare]:
        """Triangles first..last - 1 and their vertices, with the numbers of these. The first piece takes those that no triangle has, too."""
        corners = self.corners[first:last]
        used = np.zeros(len(self.positions), bool)
        used[corners] = True
        if first == 0:
            unused = np.ones(len(self.positions), bool)
            unused[self.corners] = False
            used |= unused
        numbers = np.flatnonzero(used)
        renamed = (np.cumsum(used) - 1).astype("<u2")
        return numbers, replace(
            self,
            positions=self.positions[numbers],
            attributes=self.attributes.taken(numbers),
            corners=renamed[corners],
            materials=self.materials if self.flags & ONE_MATERIAL else self.materials[first:last],
        )


def triangles_of(atom: bytes) -> int:
    """How many triangles an atom has; DamagedData if it is none."""
    return len(decode_atom(atom).triangles)


def is_atom(payload: bytes) -> bool:
    """Whether it says that it is one."""
    return payload[: len(KIND)] == KIND


def cut_atom(atom: bytes, count: int) -> list[bytes]:
    """The contents of so many parts, at most as many as there are triangles; DamagedData if it is no atom, or has too many vertices."""
    whole = _Bare.read(atom)
    total, triangles = len(whole.positions), len(whole.corners)
    assert 1 <= count <= triangles
    if total > _VERTICES_MAX:
        raise DamagedData(f"a geometry atom has {total} vertices, over {_VERTICES_MAX}")
    bounds = [triangles * number // count for number in range(count + 1)]
    contents = []
    for first, last in pairwise(bounds):
        numbers, piece = whole.piece(first, last)
        contents.append(_NUMBERS.pack(total, len(numbers)) + numbers.astype(">u2").tobytes() + piece.bytes())
    return contents


def joined_atom(contents: Sequence[bytes]) -> bytes:
    """The atom that these pieces, in order, were cut from; DamagedData if they were cut from none."""
    pieces = [_opened(content) for content in contents]
    total, _, first = pieces[0]
    shape = (first.version, first.flags, first.prototype, first.group)
    positions = np.zeros((total, 3), "<f4")
    attributes = VertexAttributes.empty(first.flags, total)
    known = np.zeros(total, bool)
    corners = []
    for size, numbers, piece in pieces:
        _require(size == total and (piece.version, piece.flags, piece.prototype, piece.group) == shape, "are of several atoms")
        positions[numbers] = piece.positions
        parts = piece.attributes.arrays()
        for name, whole in attributes.arrays().items():
            whole[numbers] = parts[name]
        known[numbers] = True
        corners.append(numbers[piece.corners])
    _require(bool(known.all()), "leave out a vertex")
    materials = first.materials if first.flags & ONE_MATERIAL else np.concatenate([piece.materials for _, _, piece in pieces])
    return replace(
        first, positions=positions, attributes=attributes, corners=np.concatenate(corners).astype("<u2"), materials=materials
    ).bytes()


def atom_of_piece(content: bytes) -> bytes:
    """The atom that a piece is by itself; DamagedData if it is none."""
    return _opened(content)[2].bytes()


def middle_of_piece(content: bytes) -> tuple[int, NDArray[np.float64]]:
    """The prototype of a piece, and the middle of the box of its triangles: float64[3], in the prototype's coordinates."""
    _, _, piece = _opened(content)
    used = piece.positions[np.unique(piece.corners)].astype(np.float64)
    middle: NDArray[np.float64] = (used.min(axis=0) + used.max(axis=0)) / 2
    return piece.prototype, middle


def _opened(content: bytes) -> tuple[int, NDArray[np.int64], _Bare]:
    """How many vertices the whole has, which of them the piece has, and the piece."""
    _require(len(content) >= _NUMBERS.size, "are cut short")
    total, count = _NUMBERS.unpack_from(content)
    _require(len(content) >= _NUMBERS.size + 2 * count, "are cut short")
    numbers = np.frombuffer(content, ">u2", count, _NUMBERS.size).astype(np.int64)
    piece = _Bare.read(content[_NUMBERS.size + 2 * count :])
    rising = bool((np.diff(numbers) > 0).all()) and (count == 0 or int(numbers[-1]) < total)
    _require(rising and len(piece.positions) == count, "number their vertices wrong")
    return total, numbers, piece


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise DamagedData(f"the pieces of a geometry atom {otherwise}")
