"""Makes small glTF files for tests, right ones and wrong ones."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")


def png(colour: tuple[int, int, int, int] = (200, 100, 50, 255), size: tuple[int, int] = (5, 3)) -> bytes:
    file = io.BytesIO()
    Image.new("RGBA", size, colour).save(file, "PNG")
    return file.getvalue()


class Maker:
    """A glTF with one scene; lists of `json` may be changed at will before `write`."""

    def __init__(self) -> None:
        self.data = b""
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "accessors": [], "bufferViews": [], "materials": [],
        }  # fmt: skip

    def add(self, kind: str, **entry: Any) -> int:
        self.json.setdefault(kind, []).append(entry)
        return len(self.json[kind]) - 1

    def node(self, *, root: bool = True, **entry: Any) -> int:
        number = self.add("nodes", **entry)
        if root:
            self.json["scenes"][0]["nodes"].append(number)
        return number

    def view(self, content: bytes) -> int:
        self.data += bytes(-len(self.data) % 4)
        offset = len(self.data)
        self.data += content
        return self.add("bufferViews", buffer=0, byteOffset=offset, byteLength=len(content))

    def accessor(self, values: Any, **more: Any) -> int:
        values = np.asarray(values)
        component = {"f": 5126, "u1": 5121, "u2": 5123, "u4": 5125}[values.dtype.kind if values.dtype.kind == "f" else values.dtype.str[1:]]
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[1 if values.ndim == 1 else values.shape[1]]
        entry = {"bufferView": self.view(values.tobytes()), "componentType": component, "count": len(values), "type": kind}
        return self.add("accessors", **(entry | more))

    def mesh(self, positions: Any = TRIANGLE, indices: Any = None, *, attributes: dict[str, Any] | None = None, **more: Any) -> int:
        attributes = {name: self.accessor(values) for name, values in (attributes or {}).items()}
        primitive: dict[str, Any] = {"attributes": {"POSITION": self.accessor(np.asarray(positions, "<f4")), **attributes}, **more}
        if indices is not None:
            primitive["indices"] = self.accessor(indices)
        return self.add("meshes", primitives=[primitive])

    def write(self, folder: Path, name: str = "test.gltf") -> Path:
        if self.data:
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path = folder / name
        path.write_text(json.dumps({key: value for key, value in self.json.items() if value != []}))
        return path
