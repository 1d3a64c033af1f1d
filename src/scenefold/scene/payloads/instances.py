"""Pages of the instance table: which prototype stands where (specs/05-scene-content.md).

    0   4s   "sfit"                 8   u32  number of the first instance
    4   u16  version, 1            12   instances, 52 bytes each: u32 prototype, f32[3,4] prototype -> world
    6   u16  instances

Instance 0 is prototype 0 under the identity: everything that the importer baked into world space. A matrix
has an inverse, and may mirror; normals go through its inverse transpose, which keeps outside outside.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, VERSION = b"sfit", 1
INSTANCE_ROW = np.dtype([("prototype", "<u4"), ("matrix", "<f4", (3, 4))])
_FLAT = 1e-12
"""Of the cube of a matrix's size: a thousandth of what an import lets pass, as no ray can be carried through less."""
INSTANCES_OF_A_PAGE = (PAYLOAD_BYTES_MAX - 12) // INSTANCE_ROW.itemsize


@dataclass(frozen=True, slots=True, eq=False)
class InstanceTable:
    """The whole table, or one page of it (`first` > 0). Arrays are read-only."""

    first: int
    prototypes: NDArray[np.uint32]
    matrices: NDArray[np.float32]
    """f32[ni, 3, 4], prototype -> world, last column the translation."""

    def __len__(self) -> int:
        return len(self.prototypes)


def encode_instances(first: int, rows: NDArray[np.void]) -> bytes:
    """A page of at most INSTANCES_OF_A_PAGE rows (INSTANCE_ROW)."""
    return finish([head(KIND, VERSION), struct.pack("<HI", len(rows), first), rows.astype(INSTANCE_ROW).tobytes()])


def decode_instances(payload: bytes) -> InstanceTable:
    """One page; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, VERSION, "page of the instance table")
    count, first = reader.unpack("HI")
    rows = reader.array(INSTANCE_ROW, count)
    reader.end()
    reader.require(count > 0, "holds no instance")
    matrices = rows["matrix"]
    reader.require(bool(np.isfinite(matrices).all()), "has a matrix that is not finite")
    linear = matrices[:, :, :3].astype(np.float64)
    volumes = np.abs((linear[:, 0] * np.cross(linear[:, 1], linear[:, 2])).sum(axis=1))
    sizes = np.sqrt((linear**2).sum(axis=(1, 2)))
    reader.require(bool((volumes > _FLAT * sizes**3).all()), "has a matrix without an inverse")
    return InstanceTable(first, rows["prototype"], matrices)


def join_instances(pages: Sequence[InstanceTable]) -> InstanceTable:
    """The table that these pages, in order, are."""
    return InstanceTable(0, np.concatenate([page.prototypes for page in pages]), np.concatenate([page.matrices for page in pages]))
