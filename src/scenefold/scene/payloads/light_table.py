"""Pages of the light table: every emissive triangle, ready to be sampled (specs/05-scene-content.md).

    0   4s   "sflt"                 8   u32  number of the first row
    4   u16  version, 1            12   rows of 76 bytes:
    6   u16  rows                       u32 instance, u32 group, u32 triangle of the group,
                                        f32[3,3] corners in the world, f32[3] emission,
                                        f32 probability, f32 threshold, u32 alias, u32 two-sided

The importer builds it once: built by every node on its own, tables would differ in bits. To draw a row, take
column i = floor(u n) and keep it if the rest of u is below threshold[i], else take alias[i] (in whole numbers: dice_kernels.column_of). The chance of
row i is luminance x area over the sum of that: `probability[i]`, in f32, as the estimator must weigh with it.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, VERSION = b"sflt", 1
LIGHT_ROW = np.dtype(
    [
        ("instance", "<u4"),
        ("group", "<u4"),
        ("triangle", "<u4"),
        ("corners", "<f4", (3, 3)),
        ("emission", "<f4", 3),
        ("probability", "<f4"),
        ("threshold", "<f4"),
        ("alias", "<u4"),
        ("two_sided", "<u4"),
    ]
)
LIGHTS_OF_A_PAGE = (PAYLOAD_BYTES_MAX - 12) // LIGHT_ROW.itemsize


@dataclass(frozen=True, slots=True, eq=False)
class LightTable:
    """The whole table, or one page of it (`first` > 0); it may be empty. Arrays are read-only."""

    first: int
    rows: NDArray[np.void]
    """LIGHT_ROW[n]"""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def instances(self) -> NDArray[np.uint32]:
        return self.rows["instance"]

    @property
    def groups(self) -> NDArray[np.uint32]:
        return self.rows["group"]

    @property
    def triangles(self) -> NDArray[np.uint32]:
        return self.rows["triangle"]

    @property
    def corners(self) -> NDArray[np.float32]:
        """f32[n, 3, 3] in the world, counter-clockwise seen from the side that shines."""
        return self.rows["corners"]

    @property
    def emission(self) -> NDArray[np.float32]:
        """f32[n, 3], radiance."""
        return self.rows["emission"]

    @property
    def two_sided(self) -> NDArray[np.uint32]:
        return self.rows["two_sided"]

    @property
    def threshold(self) -> NDArray[np.float32]:
        return self.rows["threshold"]

    @property
    def alias(self) -> NDArray[np.uint32]:
        return self.rows["alias"]

    @property
    def probability(self) -> NDArray[np.float32]:
        return self.rows["probability"]


def encode_lights(first: int, rows: NDArray[np.void]) -> bytes:
    """A page of at most LIGHTS_OF_A_PAGE rows (LIGHT_ROW)."""
    return finish([head(KIND, VERSION), struct.pack("<HI", len(rows), first), rows.astype(LIGHT_ROW).tobytes()])


def decode_lights(payload: bytes) -> LightTable:
    """One page; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, VERSION, "page of the light table")
    count, first = reader.unpack("HI")
    rows = reader.array(LIGHT_ROW, count)
    reader.end()
    reader.require(count > 0, "holds no light")
    reader.require(bool((np.abs(rows["corners"]) <= COORDINATE_ABS_MAX).all()), "has a corner that is no place")
    reader.require(bool((rows["emission"] >= 0).all() and np.isfinite(rows["emission"]).all()), "has an odd emission")
    for name in ("probability", "threshold"):
        reader.require(bool(((rows[name] >= 0) & (rows[name] <= 1)).all()), f"has a {name} outside 0 to 1")
    reader.require(bool((rows["two_sided"] <= 1).all()), "has unknown flags")
    return LightTable(first, rows)


def join_lights(pages: Sequence[LightTable]) -> LightTable:
    """The table that these pages, in order, are; empty without pages."""
    return LightTable(0, np.concatenate([np.empty(0, LIGHT_ROW), *(page.rows for page in pages)]))
