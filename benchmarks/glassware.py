"""A scene of glass for the comparison with Mitsuba, as one glTF file: spheres that bend and absorb light, and panes that scatter it.

    python benchmarks/glassware.py glassware.gltf
    python benchmarks/compare_with_mitsuba.py glassware.gltf --sky 0.5,0.6,0.7 --size 128x72 --samples 256 --depth 12

From the left: smooth glass that absorbs, rough glass of water's index, rough and coated glass of which a fifth is paint; panes of
roughness 0.05, 0.3 and 0.7 before a ball of gold; behind them stripes, above them a lamp.
"""

from __future__ import annotations

import argparse
import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
_FLOAT, _UINT = 5126, 5125


class Gltf:
    """A file in the making."""

    def __init__(self) -> None:
        self._bytes = b""
        self._doc: dict[str, Any] = {key: [] for key in ("nodes", "meshes", "materials", "accessors", "bufferViews")}

    def material(self, color: tuple[float, float, float], roughness: float = 1.0, metallic: float = 0.0, **extensions: object) -> int:
        """Its number; extensions without their KHR_materials_."""
        surface = {"baseColorFactor": [*color, 1.0], "roughnessFactor": roughness, "metallicFactor": metallic}
        named = {f"KHR_materials_{name}": told for name, told in extensions.items()}
        shines = {"emissiveFactor": [1.0, 1.0, 1.0]} if "emissive_strength" in extensions else {}
        flat = "volume" not in extensions
        return self._add("materials", {"pbrMetallicRoughness": surface, "doubleSided": flat, "extensions": named, **shines})

    def quad(
        self, origin: tuple[float, float, float], right: tuple[float, float, float], up: tuple[float, float, float], material: int
    ) -> None:
        """Seen counter-clockwise from where right x up looks."""
        o, a, b = (np.array(vector) for vector in (origin, right, up))
        self._mesh(np.stack([o, o + a, o + a + b, o + b]), None, np.array([[0, 1, 2], [0, 2, 3]]), material)

    def sphere(self, center: tuple[float, float, float], radius: float, material: int, rows: int = 40) -> None:
        """With smooth normals."""
        polar, turn = np.linspace(0, np.pi, rows + 1), np.linspace(0, 2 * np.pi, 2 * rows + 1)
        flat, height = np.sin(polar), np.outer(np.cos(polar), np.ones_like(turn))
        points = np.stack([np.outer(flat, np.cos(turn)), height, -np.outer(flat, np.sin(turn))], -1).reshape(-1, 3)
        first = (np.arange(rows)[:, None] * (2 * rows + 1) + np.arange(2 * rows)).ravel()
        below = first + 2 * rows + 1
        upper, lower = np.stack([first, below, first + 1], 1), np.stack([below, below + 1, first + 1], 1)
        # The rows at the poles have one triangle a column.
        corners = np.concatenate([upper[2 * rows :], lower[: -2 * rows]])
        self._mesh(points * radius + np.array(center), points, corners, material)

    def write(self, path: Path, eye: dict[str, Any]) -> None:
        """With one camera."""
        self._add("nodes", {"camera": 0, **eye})
        extensions = sorted({name for material in self._doc["materials"] for name in material["extensions"]})
        uri = "data:application/octet-stream;base64," + base64.b64encode(self._bytes).decode()
        camera = {"type": "perspective", "perspective": {"yfov": 0.6, "aspectRatio": 16 / 9, "znear": 0.1}}
        rest = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(self._doc["nodes"])))}], "cameras": [camera]}
        buffers = [{"byteLength": len(self._bytes), "uri": uri}]
        path.write_text(json.dumps({**rest, **self._doc, "buffers": buffers, "extensionsUsed": extensions}))

    def _add(self, table: str, item: dict[str, Any]) -> int:
        self._doc[table].append(item)
        return len(self._doc[table]) - 1

    def _mesh(self, points: F64, normals: F64 | None, corners: npt.NDArray[np.int64], material: int) -> None:
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        attributes = {"POSITION": self._accessor(points.astype(np.float32), "VEC3", _FLOAT, **bounds)}
        if normals is not None:
            attributes["NORMAL"] = self._accessor(normals.astype(np.float32), "VEC3", _FLOAT)
        indices = self._accessor(corners.astype(np.uint32).ravel(), "SCALAR", _UINT)
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        self._add("nodes", {"mesh": self._add("meshes", {"primitives": [primitive]})})

    def _accessor(self, values: npt.NDArray[Any], kind: str, component: int, **more: object) -> int:
        view = self._add("bufferViews", {"buffer": 0, "byteOffset": len(self._bytes), "byteLength": values.nbytes})
        self._bytes += values.tobytes()
        return self._add("accessors", {"bufferView": view, "componentType": component, "count": len(values), "type": kind, **more})


def glassware() -> Gltf:
    """Everything but the camera."""
    made = Gltf()
    made.quad((-4, 0, 3), (8, 0, 0), (0, 0, -6), made.material((0.6, 0.6, 0.6)))
    made.quad((-4, 0, -3), (8, 0, 0), (0, 4, 0), made.material((0.7, 0.15, 0.1)))
    blue = made.material((0.1, 0.2, 0.7))
    for stripe in range(6):
        made.quad((-3.8 + stripe * 1.3, 0.02, -2.95), (0.6, 0, 0), (0, 3.5, 0), blue)
    lamp = made.material((0.2, 0.2, 0.2), emissive_strength={"emissiveStrength": 12.0})
    made.quad((-1, 3.9, 0.5), (2, 0, 0), (0, 0, -1.2), lamp)
    all_of_it, most_of_it = {"transmissionFactor": 1.0}, {"transmissionFactor": 0.8}
    green = {"thicknessFactor": 1.0, "attenuationDistance": 0.6, "attenuationColor": [0.5, 0.85, 0.6]}
    amber = {"thicknessFactor": 1.0, "attenuationDistance": 0.8, "attenuationColor": [0.9, 0.5, 0.3]}
    white, varnish = (1.0, 1.0, 1.0), {"clearcoatFactor": 0.6, "clearcoatRoughnessFactor": 0.2}
    balls = (
        made.material(white, 0.0, transmission=all_of_it, volume=green),
        made.material(white, 0.25, transmission=all_of_it, volume=amber, ior={"ior": 1.33}),
        made.material((0.9, 0.8, 1.0), 0.5, transmission=most_of_it, volume={"thicknessFactor": 1.0}, ior={"ior": 1.7}, clearcoat=varnish),
    )
    for number, ball in enumerate(balls):
        made.sphere((-2.4 + 1.6 * number, 0.7, 0.0), 0.7, ball)
    for number, (roughness, color) in enumerate(((0.05, white), (0.3, (1.0, 0.8, 0.6)), (0.7, (0.7, 1.0, 0.8)))):
        pane = made.material(color, roughness, transmission={"transmissionFactor": 0.95})
        made.quad((1.7 + 0.6 * number, 0, 0.6 - 0.5 * number), (0.55, 0, -0.2), (0, 1.6, 0), pane)
    made.sphere((2.6, 0.45, -1.1), 0.45, made.material((0.9, 0.6, 0.1), 0.3, 1.0))
    return made


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("output", type=Path, help="the file to write")
    downwards = {"rotation": [-math.sin(0.07), 0.0, 0.0, math.cos(0.07)], "translation": [0.0, 1.6, 6.5]}
    glassware().write(parser.parse_args().output, downwards)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
