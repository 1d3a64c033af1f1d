"""Shapes of the sample scene: surfaces over a grid of two parameters, as arrays for glTF.

A shape is positions, normals, texture coordinates and triangles; its fineness is the number of grid steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]
"""Points [..., 3] of parameters u and v, each 0 to 1."""
_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    positions: Array
    normals: Array
    uvs: Array
    triangles: NDArray[np.int64]


def surface(of: Surface, steps_u: int, steps_v: int, uv_scale: tuple[float, float] = (1.0, 1.0)) -> Shape:
    """The surface over a grid of steps_u x steps_v cells; the outside is where d/du x d/dv points."""
    u, v = np.meshgrid(np.linspace(0, 1, steps_u + 1), np.linspace(0, 1, steps_v + 1), indexing="ij")
    # Inwards of the edges, so that poles and ends have a direction too.
    inner_u, inner_v = np.clip(u, 2 * _STEP, 1 - 2 * _STEP), np.clip(v, 2 * _STEP, 1 - 2 * _STEP)
    along_u = of(inner_u + _STEP, inner_v) - of(inner_u - _STEP, inner_v)
    along_v = of(inner_u, inner_v + _STEP) - of(inner_u, inner_v - _STEP)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = np.arange(steps_u)[:, None] * (steps_v + 1) + np.arange(steps_v)
    a, b, c, d = corner, corner + steps_v + 1, corner + steps_v + 2, corner + 1
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    uvs = np.stack([u * uv_scale[0], v * uv_scale[1]], -1)
    positions = of(u, v).reshape(-1, 3)
    # At a pole, half of a ring's triangles are no more than a line.
    a, b, c = (positions[triangles[:, corner]] for corner in range(3))
    triangles = triangles[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-12]
    return Shape(positions, normals.reshape(-1, 3), uvs.reshape(-1, 2), triangles)


def rectangle(corner: Array, side_u: Array, side_v: Array, uv_scale: tuple[float, float] = (1.0, 1.0)) -> Shape:
    """Two triangles; they face where side_u x side_v points."""
    return surface(lambda u, v: corner + u[..., None] * side_u + v[..., None] * side_v, 1, 1, uv_scale)


def revolution(profile: Callable[[Array], tuple[Array, Array]], around: int, along: int) -> Shape:
    """A profile (radius, height) of v, turned about the y axis."""

    def of(u: Array, v: Array) -> Array:
        radius, height = profile(v)
        angle = -2 * np.pi * u
        return np.stack([radius * np.cos(angle), height, radius * np.sin(angle)], -1)

    return surface(of, around, along)


def sphere(radius: float, around: int, along: int) -> Shape:
    return revolution(lambda v: (radius * np.sin(np.pi * v), -radius * np.cos(np.pi * v)), around, along)


def polyline_profile(points: list[tuple[float, float]]) -> Callable[[Array], tuple[Array, Array]]:
    """A profile that runs straight between (radius, height) points, evenly by their count."""
    radii, heights = np.array(points).T

    def profile(v: Array) -> tuple[Array, Array]:
        place = v * (len(points) - 1)
        numbers = np.arange(len(points))
        return np.interp(place, numbers, radii), np.interp(place, numbers, heights)

    return profile


def smooth_profile(points: list[tuple[float, float]]) -> Callable[[Array], tuple[Array, Array]]:
    """A profile through (radius, height) points along a Catmull-Rom curve."""
    knots = np.array([points[0], *points, points[-1]])

    def profile(v: Array) -> tuple[Array, Array]:
        place = v * (len(points) - 1)
        number = np.minimum(place.astype(int), len(points) - 2)
        t = (place - number)[..., None]
        before, here, there, after = (knots[number + at] for at in range(4))
        curve = here + 0.5 * t * (
            there - before + t * (2 * before - 5 * here + 4 * there - after + t * (3 * (here - there) + after - before))
        )
        return np.maximum(curve[..., 0], 0.0), curve[..., 1]

    return profile


def fluted_column(radius: float, height: float, flutes: int, around: int, along: int) -> Shape:
    """A column that swells a little, with rounded grooves that fade out at both ends."""

    def of(u: Array, v: Array) -> Array:
        swell = 1.0 - 0.16 * v**1.6
        fade = np.clip(np.minimum(v, 1 - v) * 18, 0, 1)
        groove = 1.0 - 0.075 * fade * np.abs(np.cos(np.pi * flutes * u)) ** 3
        angle = -2 * np.pi * u
        return np.stack([radius * swell * groove * np.cos(angle), height * v, radius * swell * groove * np.sin(angle)], -1)

    return surface(of, around, along)


def tube(path: Callable[[Array], Array], radius: float, along: int, around: int) -> Shape:
    """A tube about a closed path of parameter 0 to 1. The angle runs so that triangles face outwards."""

    def of(u: Array, v: Array) -> Array:
        ahead, behind, here = path(u + _STEP), path(u - _STEP), path(u)
        forward = ahead - behind
        bend = ahead + behind - 2 * here
        side = np.cross(forward, bend)
        side /= np.linalg.norm(side, axis=-1, keepdims=True)
        up = np.cross(side, forward)
        up /= np.linalg.norm(up, axis=-1, keepdims=True)
        angle = (2 * np.pi * v)[..., None]
        return here + radius * (np.cos(angle) * up - np.sin(angle) * side)

    return surface(of, along, around)


def torus_knot(u: Array) -> Array:
    """The (2, 3) torus knot, standing, about 1 in size."""
    angle = 2 * np.pi * u
    radius = 0.62 + 0.26 * np.cos(3 * angle)
    return np.stack([radius * np.cos(2 * angle), radius * np.sin(2 * angle), 0.30 * np.sin(3 * angle)], -1)


def moved(shape: Shape, by: tuple[float, float, float]) -> Shape:
    return Shape(shape.positions + np.array(by), shape.normals, shape.uvs, shape.triangles)


def joined(*shapes: Shape) -> Shape:
    before = np.cumsum([0] + [len(shape.positions) for shape in shapes])
    return Shape(
        np.concatenate([shape.positions for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
        np.concatenate([shape.uvs for shape in shapes]),
        np.concatenate([shape.triangles + start for shape, start in zip(shapes, before, strict=False)]),
    )
