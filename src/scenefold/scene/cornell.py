"""The Cornell box as a glTF file, with the measures, reflectances and light of Mitsuba 3's own (`mitsuba.cornell_box()`).

A room of 2 x 2 x 2 without front, a red wall on the left, a green one on the right, two boxes and a lamp under the
ceiling. People compare renderers with it, so it must be the same scene to the number. `scenectl bench render --scene cornell`.

glTF knows no surface that is purely diffuse; an index of refraction of 1 leaves of the coat only what shines at grazing angles.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import numpy.typing as npt

_F32 = npt.NDArray[np.float32]

WHITE = (0.885809, 0.698859, 0.666422)
GREEN = (0.105421, 0.37798, 0.076425)
RED = (0.570068, 0.0430135, 0.0443706)
LAMP = (18.387, 13.9873, 6.75357)
"""Radiance."""
FIELD_OF_VIEW = 39.3077
"""Degrees, of the shorter side of the image."""
CAMERA_DISTANCE = 3.9

_FLOAT = 5126
_X, _Y, _Z = np.eye(3)


def cornell_box() -> bytes:
    """The scene as the bytes of a .glb file."""
    shapes = [
        ("floor", 0, _rectangle((0, -1, 0), _X, -_Z)),
        ("ceiling", 0, _rectangle((0, 1, 0), _X, _Z)),
        ("back", 0, _rectangle((0, 0, -1), _X, _Y)),
        ("green wall", 1, _rectangle((1, 0, 0), _Z, _Y)),
        ("red wall", 2, _rectangle((-1, 0, 0), -_Z, _Y)),
        ("small box", 0, _box((0.335, -0.7, 0.38), -17.0, (0.3, 0.3, 0.3))),
        ("large box", 0, _box((-0.33, -0.4, -0.28), 18.25, (0.3, 0.61, 0.3))),
        ("lamp", 3, _rectangle((0, 0.99, 0.01), 0.23 * _X, 0.19 * _Z)),
    ]
    return _glb(shapes)


def _rectangle(centre: tuple[float, float, float], u: npt.NDArray[np.float64], v: npt.NDArray[np.float64]) -> _F32:
    """Two triangles, float32[6, 3], over the corners centre +- u +- v; they face along u x v."""
    corners = np.array(centre) + np.array([-u - v, u - v, u + v, -u + v])
    points: _F32 = corners[[0, 1, 2, 0, 2, 3]].astype(np.float32)
    return points


def _box(centre: tuple[float, float, float], degrees: float, half: tuple[float, float, float]) -> _F32:
    """Twelve triangles, float32[36, 3], turned around the vertical axis."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    x, y, z = (turn * np.array(half)).T
    sides = ((x, y, z), (-x, z, y), (y, z, x), (-y, x, z), (z, x, y), (-z, y, x))
    place = np.array(centre)
    return np.concatenate([_rectangle(tuple(place + out), u, v) for out, u, v in sides])


def _glb(shapes: list[tuple[str, int, _F32]]) -> bytes:
    data = b"".join(points.astype("<f4").tobytes() for _, _, points in shapes)
    views, accessors, meshes, at = [], [], [], 0
    for number, (name, material, points) in enumerate(shapes):
        views.append({"buffer": 0, "byteOffset": at, "byteLength": points.nbytes})
        at += points.nbytes
        bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        accessors.append({"bufferView": number, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds})
        meshes.append({"name": name, "primitives": [{"attributes": {"POSITION": number}, "material": material}]})
    nodes: list[dict[str, Any]] = [{"name": name, "mesh": number} for number, (name, _, _) in enumerate(shapes)]
    nodes.append({"name": "camera", "camera": 0, "translation": [0, 0, CAMERA_DISTANCE]})
    lens = {"yfov": float(np.radians(FIELD_OF_VIEW)), "znear": 0.001, "zfar": 100.0}
    document = {
        "asset": {"version": "2.0", "generator": "scenefold"},
        "extensionsUsed": ["KHR_materials_ior", "KHR_materials_emissive_strength"],
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "cameras": [{"name": "camera", "type": "perspective", "perspective": lens}],
        "materials": [_diffuse("white", WHITE), _diffuse("green", GREEN), _diffuse("red", RED), _lamp()],
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def _diffuse(name: str, colour: tuple[float, float, float]) -> dict[str, Any]:
    surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    return {"name": name, "pbrMetallicRoughness": surface, "extensions": {"KHR_materials_ior": {"ior": 1.0}}}


def _lamp() -> dict[str, Any]:
    lamp = _diffuse("lamp", WHITE)
    strength = max(LAMP)
    lamp["emissiveFactor"] = [channel / strength for channel in LAMP]
    lamp["extensions"]["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
    return lamp
