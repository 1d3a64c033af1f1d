"""glTF accessors as arrays: views of the file where its layout allows, copies where it does not.

Every claim (count, offset, stride) is held against the bytes that are there before anything is allocated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.gltf_file import GltfFile
from scenefold.scene.importers.gltf_json import JsonMap
from scenefold.scene.importers.gltf_vertices import Rows, Vertices

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_DATALESS_MAX = 1_000_000
"""An accessor without data means zeros, of any number; more than this is no mesh that anybody wants."""


class Accessors:
    """The accessors of one file. Of those that are read in `rows` (ascending; None: all), nothing else is looked at."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._entries = file.json.maps("accessors")

    def __len__(self) -> int:
        return len(self._entries)

    def count(self, number: int) -> int:
        return self._entries[number].integer("count", 1)

    def held(self, number: int, kind: str) -> int:
        """How many elements of type `kind` there are; LocalFault if the file does not hold as many as it claims."""
        entry = self._typed(number, kind)
        return len(self._base(entry))

    def of_vertices(self, attributes: JsonMap, name: str, vertices: Vertices) -> int:
        """The number of the accessor of an attribute; -1 without one. LocalFault if it is of other vertices than these."""
        number = attributes.index(name, len(self._entries), "accessor")
        if number >= 0 and self.count(number) != vertices.count:
            raise attributes.fault(f"has {self.count(number)} elements, but there are {vertices.count} positions", name)
        return number

    def floats(self, number: int, kind: str, rows: Rows | None = None) -> NDArray[np.float32]:
        """f32[n, width] of type `kind` (such as "VEC3"); whole numbers are converted, normalised if so marked."""
        entry = self._typed(number, kind)
        raw = self._raw(entry, rows)
        values = raw.astype(np.float32, copy=False)
        if raw.dtype.kind != "f" and entry.flag("normalized"):
            values /= np.float32(np.iinfo(raw.dtype.str).max)
            np.maximum(values, np.float32(-1), out=values)
        return values

    def doubles(self, number: int, kind: str) -> NDArray[np.float64]:
        """f64[n, width], as `floats`."""
        return _widened(self.floats(number, kind))

    def shares(self, number: int, kinds: tuple[str, ...], rows: Rows | None = None) -> NDArray[np.float32]:
        """f32[n, width] of one of these types: whole numbers are shares of the largest there is, marked so or not."""
        entry = self._entries[number]
        if entry.text("type") not in kinds:
            raise entry.fault(f"is {entry.text('type')!r}, where {' or '.join(kinds)} is needed", "type")
        raw = self._raw(entry, rows)
        values = raw.astype(np.float32, copy=False)
        return values if raw.dtype.kind == "f" else values / np.float32(np.iinfo(raw.dtype.str).max)

    def numbers(self, number: int, kind: str, rows: Rows | None = None) -> NDArray[np.generic]:
        """Unsigned whole numbers [n, width] of type `kind`, as wide as they are stored."""
        entry = self._entries[number]
        raw = self._raw(entry, rows)
        if entry.text("type") != kind or raw.dtype.kind != "u":
            raise entry.fault(f"holds no unsigned whole numbers of type {kind}")
        return raw

    def indices(self, number: int) -> NDArray[np.uint32]:
        """u32[n]."""
        entry = self._entries[number]
        raw = self._raw(entry)
        if entry.text("type") != "SCALAR" or raw.dtype.kind != "u":
            raise entry.fault("holds no indices: they are unsigned scalars")
        return raw[:, 0].astype(np.uint32)

    def _typed(self, number: int, kind: str) -> JsonMap:
        entry = self._entries[number]
        if entry.text("type") != kind:
            raise entry.fault(f"is {entry.text('type')!r}, where {kind} is needed", "type")
        return entry

    def _raw(self, entry: JsonMap, rows: Rows | None = None) -> NDArray[np.generic]:
        values = self._base(entry)
        if entry.has("sparse"):
            return self._with_sparse(entry, values, rows)
        return values if rows is None else values[rows]

    def _base(self, entry: JsonMap) -> NDArray[np.generic]:
        """[n, width] without what is said sparsely."""
        count = entry.integer("count", 1)
        width = _WIDTHS.get(entry.text("type"))
        if width is None:
            raise entry.fault(f"is the unknown {entry.text('type')!r}", "type")
        return self._elements(entry, entry, count, width, self._component(entry))

    def _component(self, entry: JsonMap) -> np.dtype[np.generic]:
        code = entry.integer("componentType")
        if code not in _COMPONENTS:
            raise entry.fault(f"is the unknown {code}", "componentType")
        return np.dtype(_COMPONENTS[code])

    def _elements(self, entry: JsonMap, reference: JsonMap, count: int, width: int, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
        """`count` elements where `reference` (an accessor, or a part of its sparse) says that they lie."""
        view = reference.index("bufferView", self._file.views, "buffer view")
        if view < 0:
            if count > _DATALESS_MAX:
                raise entry.fault(f"claims {count} elements without data", "count")
            return np.zeros((count, width), dtype)
        content, stride = self._file.view(view)
        offset = reference.integer("byteOffset", default=0)
        size = width * dtype.itemsize
        step = stride or size
        if step < size:
            raise reference.fault(f"has elements of {size} bytes every {step} bytes")
        end = offset + step * (count - 1) + size
        if end > len(content):
            raise reference.fault(f"claims {count} elements, up to byte {end}, of a view of {len(content)} bytes")
        return np.ndarray((count, width), dtype, content, offset, (step, dtype.itemsize))

    def _with_sparse(self, entry: JsonMap, base: NDArray[np.generic], rows: Rows | None) -> NDArray[np.generic]:
        count, width = base.shape
        sparse = entry.inner("sparse")
        changed = sparse.integer("count", 1, count)
        places, values = sparse.inner("indices"), sparse.inner("values")
        for part in (places, values):
            if not part.has("bufferView"):
                raise part.fault("is missing", "bufferView")
        where = self._elements(entry, places, changed, 1, self._component(places))[:, 0]
        if where.dtype.kind != "u" or int(where.max()) >= count:
            raise places.fault(f"names elements beyond the {count} that there are")
        new = self._elements(entry, values, changed, width, base.dtype)
        if rows is None:
            result = base.copy()
            result[where] = new
            return result
        result = base[rows]
        at = np.searchsorted(rows, where)
        # What lies behind the last row is none of them.
        among = at < len(rows)
        among[among] = rows[at[among]] == where[among]
        result[at[among]] = new[among]
        return result


def _widened(values: NDArray[np.float32]) -> NDArray[np.float64]:
    # A signalling NaN, which a file may hold, becomes a quiet one with a warning; who reads it looks for NaN anyway.
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)
