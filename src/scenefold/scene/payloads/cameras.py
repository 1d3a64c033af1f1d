"""Cameras (specs/05-scene-content.md). A camera looks along its -Z, with +Y up and +X to the right.

The matrix (camera -> world) is a rotation and a translation: an importer takes scale and shear out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.payloads.values import Fields, decode_page, encode_pages, shorten

KIND, VERSION = "cameras", 1


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    name: str
    matrix: NDArray[np.float64]
    """f64[4, 4], camera -> world, read-only."""
    kind: Literal["perspective", "orthographic"] = "perspective"
    yfov: float = 0.8
    """Full vertical angle of view in radians, 0 < yfov < pi (perspective)."""
    ymag: float = 1.0
    """Half the height of the view in world units (orthographic)."""
    aspect: float = 0.0
    """Width by height; 0: that of the image."""
    near: float = 0.0
    """Nothing nearer is seen."""


def encode_cameras(cameras: Sequence[Camera]) -> list[bytes]:
    """Pages in order."""
    return encode_pages(KIND, VERSION, [_to_map(camera) for camera in cameras])


def decode_cameras(payload: bytes) -> tuple[int, list[Camera]]:
    """The number of a page's first camera, and its cameras; DamagedData if anything is off."""
    return decode_page(payload, KIND, VERSION, _from_fields)


def is_rigid(matrix: NDArray[np.float64]) -> bool:
    """Whether a f64[4, 4] is a rotation and a translation, to within rounding; a mirror is not."""
    rotation = matrix[:3, :3]
    orthonormal = bool((np.abs((rotation[:, :, None] * rotation[:, None, :]).sum(axis=0) - np.eye(3)) < 1e-6).all())
    places = bool((np.abs(matrix[:3, 3]) <= COORDINATE_ABS_MAX).all())
    last_row = matrix[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    right_handed = float(np.dot(np.cross(rotation[:, 0], rotation[:, 1]), rotation[:, 2])) > 0
    return orthonormal and places and last_row and right_handed


def _to_map(camera: Camera) -> dict[str, Any]:
    return {
        "name": shorten(camera.name),
        "matrix": [float(value) for value in camera.matrix.ravel()],
        "kind": camera.kind,
        "yfov": float(camera.yfov),
        "ymag": float(camera.ymag),
        "aspect": float(camera.aspect),
        "near": float(camera.near),
    }


def _from_fields(fields: Fields) -> Camera:
    matrix = np.array(fields.numbers("matrix", 16), np.float64).reshape(4, 4)
    matrix.flags.writeable = False
    fields.require(is_rigid(matrix), "has a matrix that is no rotation and translation")
    kind = fields.text("kind")
    fields.require(kind in ("perspective", "orthographic"), f"has the unknown kind {kind!r}")
    camera = Camera(
        name=fields.text("name"),
        matrix=matrix,
        kind="perspective" if kind == "perspective" else "orthographic",
        yfov=fields.number("yfov", 0.0, math.pi),
        ymag=fields.number("ymag", 0.0, COORDINATE_ABS_MAX),
        aspect=fields.number("aspect", 0.0, 1e6),
        near=fields.number("near", 0.0),
    )
    fields.require(0 < camera.yfov < math.pi and camera.ymag > 0, "has a view without size")
    return camera
