"""Pages of the light table: every emissive triangle, ready to be sampled (specs/05-scene-content.md).

    0   4s   "sflt"                 8   u32  number of the first row
    4   u16  version, 1 or 2       12   rows of 76 bytes (version 2: 104):
    6   u16  rows                       u32 instance, u32 group, u32 triangle of the group,
                                        f32[3,3] corners in the world, f32[3] emission,
                                        f32 probability, f32 threshold, u32 alias, u32 two-sided,
                                        version 2 alone: u32 material, f32[3,2] texture coordinates

The importer builds it once: built by every node on its own, tables would differ in bits. To draw a row, take
column i = floor(u n) and keep it if the rest of u is below threshold[i], else take alias[i] (in whole numbers: dice_kernels.column_of). The chance of
row i is luminance x area over the sum of that: `probability[i]`, in f32, as the estimator must weigh with it.

Version 2 is written where an emissive texture tells what a point of a row sends out: `emission` is its mean. The material names the
texture, and the coordinates are those of the corners, of the set that it reads; they are 0 and the material NO_MATERIAL where none is read.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import COORDINATE_ABS_MAX, PAYLOAD_BYTES_MAX
from scenefold.scene.payloads.binary import PayloadReader, finish, head

KIND, OLDEST, NEWEST = b"sflt", 1, 2
NO_MATERIAL = 0xFFFFFFFF
"""Of a row that has its emission everywhere."""
_PLAIN_ROW = np.dtype(
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
"""As version 1 has it."""
LIGHT_ROW = np.dtype([*_PLAIN_ROW.descr, ("material", "<u4"), ("coordinates", "<f4", (3, 2))])
_HEAD_BYTES = 12
_ROW_OF = {OLDEST: _PLAIN_ROW, NEWEST: LIGHT_ROW}


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
    def materials(self) -> NDArray[np.uint32]:
        """u32[n], the material whose emissive texture is read; NO_MATERIAL: none."""
        return self.rows["material"]

    @property
    def coordinates(self) -> NDArray[np.float32]:
        """f32[n, 3, 2], of the corners: where that texture is read, before its transform."""
        return self.rows["coordinates"]

    @property
    def probability(self) -> NDArray[np.float32]:
        return self.rows["probability"]


def light_rows(count: int) -> NDArray[np.void]:
    """LIGHT_ROW[count] of zeros, without textures."""
    rows = np.zeros(count, LIGHT_ROW)
    rows["material"] = NO_MATERIAL
    return rows


def lights_of_a_page(mapped: bool) -> int:
    """How many rows fit; `mapped`: where some row of the table has a texture."""
    return (PAYLOAD_BYTES_MAX - _HEAD_BYTES) // _ROW_OF[NEWEST if mapped else OLDEST].itemsize


def encode_lights(rows: NDArray[np.void]) -> list[bytes]:
    """The pages of a table (LIGHT_ROW[n]), in order; of version 1 if no row has a texture, so that older programs read them."""
    mapped = bool((rows["material"] != NO_MATERIAL).any())
    version, most = NEWEST if mapped else OLDEST, lights_of_a_page(mapped)
    kind = _ROW_OF[version]
    pages = ((first, rows[first : first + most]) for first in range(0, len(rows), most))
    return [finish([head(KIND, version), struct.pack("<HI", len(page), first), _packed(page, kind)]) for first, page in pages]


def _packed(rows: NDArray[np.void], kind: np.dtype[np.void]) -> bytes:
    packed = np.empty(len(rows), kind)
    for name in kind.names or ():
        packed[name] = rows[name]
    return packed.tobytes()


def decode_lights(payload: bytes) -> LightTable:
    """One page; DamagedData if anything is off."""
    reader = PayloadReader(payload, KIND, OLDEST, "page of the light table", newest=NEWEST)
    count, first = reader.unpack("HI")
    found = reader.array(_ROW_OF[reader.version], count)
    reader.end()
    reader.require(count > 0, "holds no light")
    rows = light_rows(count)
    for name in found.dtype.names or ():
        rows[name] = found[name]
    rows.flags.writeable = False
    reader.require(bool((np.abs(rows["corners"]) <= COORDINATE_ABS_MAX).all()), "has a corner that is no place")
    reader.require(bool((rows["emission"] >= 0).all() and np.isfinite(rows["emission"]).all()), "has an odd emission")
    for name in ("probability", "threshold"):
        reader.require(bool(((rows[name] >= 0) & (rows[name] <= 1)).all()), f"has a {name} outside 0 to 1")
    reader.require(bool((rows["two_sided"] <= 1).all()), "has unknown flags")
    reader.require(bool(np.isfinite(rows["coordinates"]).all()), "has an infinite texture coordinate")
    return LightTable(first, rows)


def join_lights(pages: Sequence[LightTable]) -> LightTable:
    """The table that these pages, in order, are; empty without pages."""
    return LightTable(0, np.concatenate([np.empty(0, LIGHT_ROW), *(page.rows for page in pages)]))
