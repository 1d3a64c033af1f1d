"""Writes a GLB: just as much of glTF 2.0 as the sample scene needs."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sample_shapes import Shape

_FLOAT, _U16, _U32 = 5126, 5123, 5125


class GlbWriter:
    """Collects meshes, materials, images and nodes; `write` makes the file."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "scenefold tools/make_sample_scene.py"},
            "scene": 0, "scenes": [{"nodes": []}], "extensionsUsed": [],
        }  # fmt: skip
        self.triangles = 0

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        """Appends to a list such as "materials"; the entry's number."""
        entries: list[dict[str, Any]] = self._json.setdefault(kind, [])
        entries.append(entry)
        for name in entry.get("extensions", {}):
            if name not in self._json["extensionsUsed"]:
                self._json["extensionsUsed"].append(name)
        return len(entries) - 1

    def node(self, **entry: Any) -> None:
        self._json["scenes"][0]["nodes"].append(self.add("nodes", entry))

    def image(self, png: bytes) -> int:
        """A texture of this PNG file."""
        image = self.add("images", {"mimeType": "image/png", "bufferView": self._view(png)})
        return self.add("textures", {"source": image})

    def mesh(self, name: str, shape: Shape, material: int, *, textured: bool = False) -> int:
        attributes = {
            "POSITION": self._accessor(shape.positions.astype("<f4"), "VEC3", _FLOAT, bounds=True),
            "NORMAL": self._accessor(shape.normals.astype("<f4"), "VEC3", _FLOAT),
        }
        if textured:
            attributes["TEXCOORD_0"] = self._accessor(shape.uvs.astype("<f4"), "VEC2", _FLOAT)
        small = len(shape.positions) < 65_535
        indices = shape.triangles.ravel().astype("<u2" if small else "<u4")
        self.triangles += len(shape.triangles)
        primitive = {
            "attributes": attributes,
            "indices": self._accessor(indices, "SCALAR", _U16 if small else _U32),
            "material": material,
        }
        return self.add("meshes", {"name": name, "primitives": [primitive]})

    def _view(self, data: bytes) -> int:
        self._data += bytes(-len(self._data) % 4)
        view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)}
        self._data += data
        return self.add("bufferViews", view)

    def _accessor(self, values: NDArray[Any], kind: str, component: int, *, bounds: bool = False) -> int:
        entry = {"bufferView": self._view(values.tobytes()), "componentType": component, "count": len(values), "type": kind}
        if bounds:
            entry |= {"min": np.min(values, axis=0).tolist(), "max": np.max(values, axis=0).tolist()}
        return self.add("accessors", entry)

    def write(self, path: Path) -> int:
        """Writes the file; its size in bytes."""
        self._data += bytes(-len(self._data) % 4)
        self._json["buffers"] = [{"byteLength": len(self._data)}]
        text = json.dumps(self._json, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        size = 12 + 8 + len(text) + 8 + len(self._data)
        head = struct.pack("<4sII", b"glTF", 2, size)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(self._data), 0x004E4942)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(head + chunks + self._data)
        return size
