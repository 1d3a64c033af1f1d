"""A camera for a file that has none: it looks at the whole box from above one corner, from outside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.payloads.cameras import Camera

FRAMED = "framed"
_YFOV = 0.7
_FROM = np.array([0.55, 0.45, 1.0])
_MARGIN = 1.05


def framing_camera(low: NDArray[np.float64], high: NDArray[np.float64]) -> Camera:
    """A perspective camera that sees the box (f64[3] each) whole in any image at least as wide as high."""
    middle = (low + high) / 2
    z = _FROM / math.sqrt(float((_FROM**2).sum()))
    x = np.cross([0.0, 1.0, 0.0], z)
    x = x / math.sqrt(float((x**2).sum()))
    y = np.cross(z, x)
    corners = np.array([[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)]) - middle
    # Every corner must lie within the cone: |across| <= tan(half angle) x (distance - along).
    along = (corners * z).sum(axis=1)
    across = np.maximum(np.abs((corners * x).sum(axis=1)), np.abs((corners * y).sum(axis=1)))
    distance = float((along + across * (_MARGIN / math.tan(_YFOV / 2))).max())
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, y, z
    matrix[:3, 3] = middle + z * distance
    return Camera(FRAMED, matrix, yfov=_YFOV)


def default_camera(cameras: list[Camera]) -> str:
    """The name of the camera that renders when none is asked for: "main", or "Camera" (as modelling programs
    name their first one), else the first of the file."""
    for wanted in ("main", "camera"):
        for camera in cameras:
            if camera.name.lower() == wanted:
                return camera.name
    return cameras[0].name
