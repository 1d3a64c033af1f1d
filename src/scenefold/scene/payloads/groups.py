"""Pages of the group table: which atoms make a group, and where they lie (specs/05-scene-content.md).

    0   4s   "sfgt"               12   groups, 36 bytes each:  u32 prototype, u32 triangles, u16 atoms,
    4   u16  version, 1, 2                                     u8 flags, u8 zero, f32[3] low, f32[3] high
    6   u16  groups                    atoms, 48 bytes each:   20 bytes location, u32 triangles,
    8   u32  number of the first                               f32[3] low, f32[3] high

The atoms of all groups follow in order. A group's triangles are those of its atoms, in order: that is the
number by which the light table and the caster name a triangle. Boxes are in the prototype's space, exact. Flags are those of
version 1 or of version 2 of atoms, as the page's version says; the older is written where it suffices.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import ATOM_TRIANGLES_MAX, COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX
from scenefold.base.location import LOCATION_BYTES, Location
from scenefold.scene.payloads.binary import PayloadReader, finish, head
from scenefold.scene.payloads.vertex_attributes import ATTRIBUTE_FLAGS, OLD_FLAGS

KIND, OLDEST, NEWEST = b"sfgt", 1, 2
_HEAD_BYTES = 12
GROUP_ROW = np.dtype(
    [
        ("prototype", "<u4"),
        ("triangles", "<u4"),
        ("atoms", "<u2"),
        ("flags", "u1"),
        ("zero", "u1"),
        ("low", "<f4", 3),
        ("high", "<f4", 3),
    ]
)
ATOM_ROW = np.dtype([("location", "V20"), ("triangles", "<u4"), ("low", "<f4", 3), ("high", "<f4", 3)])

assert ATOM_ROW["location"].itemsize == LOCATION_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class GroupTable:
    """The whole table, or one page of it (`first` > 0). Arrays are read-only."""

    first: int
    prototypes: NDArray[np.uint32]
    triangles: NDArray[np.uint32]
    """Number of triangles of each group."""
    flags: NDArray[np.uint8]
    """HAS_NORMALS and the like (vertex_attributes.py): all atoms of a group have the same attributes."""
    low: NDArray[np.float32]
    """f32[ng, 3], like `high` in prototype space."""
    high: NDArray[np.float32]
    first_atom: NDArray[np.int64]
    """i64[ng + 1]: group g has the atoms first_atom[g] to first_atom[g + 1] - 1."""
    atoms: NDArray[np.void]
    """ATOM_ROW[na]: location, triangles, low, high of every atom."""

    def __len__(self) -> int:
        return len(self.prototypes)

    def locations(self, group: int) -> list[Location]:
        """Where the atoms of a group lie in GEOMETRY, in order."""
        rows = self.atoms["location"][self.first_atom[group] : self.first_atom[group + 1]]
        return [Location(row.tobytes()) for row in rows]


def encode_groups(first: int, groups: NDArray[np.void], atoms: NDArray[np.void]) -> bytes:
    """A page of groups (GROUP_ROW) and all their atoms (ATOM_ROW)."""
    assert int(groups["atoms"].sum()) == len(atoms)
    is_old = not (groups["flags"] & ~np.uint8(OLD_FLAGS)).any()
    page_head = head(KIND, OLDEST if is_old else NEWEST) + struct.pack("<HI", len(groups), first)
    return finish([page_head, groups.astype(GROUP_ROW).tobytes(), atoms.astype(ATOM_ROW).tobytes()])


def page_bounds(atoms_of_groups: Sequence[int]) -> list[int]:
    """Cuts [0, ..., groups] so that each page fits one record."""
    bounds, size = [0], _HEAD_BYTES
    for group, atoms in enumerate(atoms_of_groups):
        row = GROUP_ROW.itemsize + atoms * ATOM_ROW.itemsize
        if size + row > PAYLOAD_BYTES_MAX:
            bounds.append(group)
            size = _HEAD_BYTES
        size += row
    return [*bounds, len(atoms_of_groups)]


def decode_groups(payload: bytes) -> GroupTable:
    """One page; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, OLDEST, "page of the group table", newest=NEWEST)
    count, first = reader.unpack("HI")
    rows = reader.array(GROUP_ROW, count)
    atoms = reader.array(ATOM_ROW, int(rows["atoms"].sum(dtype=np.int64)))
    reader.end()
    reader.require(count > 0 and bool((rows["atoms"] > 0).all()), "has an empty group")
    known = np.uint8(OLD_FLAGS if reader.version == OLDEST else ATTRIBUTE_FLAGS)
    reader.require(not (rows["zero"].any() or (rows["flags"] & ~known).any()), "has unknown flags")
    first_atom = np.concatenate([[0], np.cumsum(rows["atoms"], dtype=np.int64)])
    reader.require(bool(((atoms["triangles"] > 0) & (atoms["triangles"] <= ATOM_TRIANGLES_MAX)).all()), "has an odd atom")
    sums = np.add.reduceat(atoms["triangles"].astype(np.int64), first_atom[:-1])
    reader.require(bool((sums == rows["triangles"]).all()), "counts its triangles wrong")
    for table in (rows, atoms):
        boxed = (table["low"] >= -COORDINATE_ABS_MAX) & (table["low"] <= table["high"])
        reader.require(bool((boxed & (table["high"] <= COORDINATE_ABS_MAX)).all()), "has a box that is none")
    return GroupTable(first, rows["prototype"], rows["triangles"], rows["flags"], rows["low"], rows["high"], first_atom, atoms)


def join_groups(pages: Sequence[GroupTable]) -> GroupTable:
    """The table that these pages, in order, are."""
    atoms_before = np.cumsum([0] + [len(page.atoms) for page in pages])
    first_atom = [page.first_atom[:-1] + before for page, before in zip(pages, atoms_before[:-1], strict=True)]
    return GroupTable(
        0,
        np.concatenate([page.prototypes for page in pages]),
        np.concatenate([page.triangles for page in pages]),
        np.concatenate([page.flags for page in pages]),
        np.concatenate([page.low for page in pages]),
        np.concatenate([page.high for page in pages]),
        np.concatenate([*first_atom, atoms_before[-1:]]),
        np.concatenate([page.atoms for page in pages]),
    )
