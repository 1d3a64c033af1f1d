"""Meshes, cameras and a small scene with everything in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenefold.scene.importers.source import MeshPart, SourceScene, SourceTexture
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.materials import Material, TextureUse
from scenefold.scene.payloads.punctual import PunctualLight

Mesh = list[MeshPart]
Matrix = NDArray[np.float64]


def part(positions: object, triangles: object, material: int, *, uvs: object = None, normals: object = None) -> MeshPart:
    """A mesh part from nested lists or arrays."""
    return MeshPart(
        np.ascontiguousarray(positions, np.float32),
        None if normals is None else np.ascontiguousarray(normals, np.float32),
        None if uvs is None else np.ascontiguousarray(uvs, np.float32),
        np.ascontiguousarray(triangles, np.uint32),
        material,
    )


def grid(corner: object, side_u: object, side_v: object, cuts: int, material: int, *, textured: bool = False) -> MeshPart:
    """A parallelogram of 2 x cuts x cuts triangles whose normal is side_u x side_v."""
    start, u, v = (np.asarray(value, np.float64) for value in (corner, side_u, side_v))
    steps = np.linspace(0.0, 1.0, cuts + 1)
    s, t = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing="ij"))
    positions = start + s[:, None] * u + t[:, None] * v
    cells = np.arange((cuts + 1) * cuts).reshape(cuts, cuts + 1)[:, :cuts].ravel()
    a, b, c, d = cells, cells + cuts + 1, cells + cuts + 2, cells + 1
    triangles = np.stack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)], 1).reshape(-1, 3)
    return part(positions, triangles, material, uvs=np.stack([s, 1.0 - t], 1) if textured else None)


def ball(centre: object, radius: float, cuts: int, material: int, *, smooth: bool = False, inwards: bool = False) -> MeshPart:
    """A sphere of 4 x cuts x (cuts - 1) triangles, its poles along y."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, cuts + 1), np.linspace(0, 2 * np.pi, 2 * cuts, endpoint=False), indexing="ij")
    directions = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], -1).reshape(-1, 3)
    row, column = (axis.ravel() for axis in np.meshgrid(np.arange(cuts), np.arange(2 * cuts), indexing="ij"))
    following = (column + 1) % (2 * cuts)
    a, b = row * 2 * cuts + column, row * 2 * cuts + following
    c, d = a + 2 * cuts, b + 2 * cuts
    upper, lower = np.stack([a, d, c], 1)[row < cuts], np.stack([a, b, d], 1)[row < cuts]
    triangles = np.concatenate([upper[row < cuts - 1], lower[row > 0]])
    # The last row's lower corners coincide in the pole, as do the first row's upper ones: those triangles stay out.
    triangles = np.concatenate([triangles, np.stack([a, b, d], 1)[row == cuts - 1], np.stack([a, d, c], 1)[row == 0]])
    triangles = np.unique(triangles, axis=0)
    if inwards:
        triangles = triangles[:, ::-1]
    positions = np.asarray(centre, np.float64) + radius * directions
    return part(positions, triangles, material, normals=directions if smooth else None)


def looking(eye: object, target: object, **options: object) -> Camera:
    """A camera at `eye` that looks at `target`, up being y (or z, if it looks along y)."""
    position = np.asarray(eye, np.float64)
    forward = np.asarray(target, np.float64) - position
    forward /= np.linalg.norm(forward)
    up = np.array([0.0, 1.0, 0.0]) if abs(forward[1]) < 0.99 else np.array([0.0, 0.0, 1.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2], matrix[:3, 3] = right, np.cross(right, forward), -forward, position
    return Camera("eye", matrix, **options)  # type: ignore[arg-type]


def moved(x: float, y: float, z: float, scale: float = 1.0, turn: float = 0.0) -> Matrix:
    """A translation after a scale and a turn about y."""
    matrix = np.eye(4)
    c, s = np.cos(turn) * scale, np.sin(turn) * scale
    matrix[0, 0], matrix[0, 2], matrix[1, 1], matrix[2, 0], matrix[2, 2] = c, s, scale, -s, c
    matrix[:3, 3] = x, y, z
    return matrix


def scene(
    meshes: Sequence[Mesh],
    materials: Sequence[Material],
    cameras: Sequence[Camera],
    *,
    placed: Sequence[tuple[int, Matrix]] | None = None,
    textures: Sequence[SourceTexture] = (),
    punctual: Sequence[PunctualLight] = (),
) -> SourceScene:
    """Each mesh once, in place, unless `placed` says otherwise."""
    where = [(number, np.eye(4)) for number in range(len(meshes))] if placed is None else list(placed)
    return SourceScene(
        "test",
        list(meshes),
        np.array([number for number, _ in where], np.int64),
        np.array([matrix for _, matrix in where]),
        list(materials),
        list(textures),
        list(cameras),
        list(punctual),
    )


def checkers(size: int) -> SourceTexture:
    """A coloured checkerboard with some noise in it."""
    pixels = np.random.default_rng(1).integers(40, 220, (size, size, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[: size // 2, : size // 2, 0] = 250
    pixels[size // 2 :, size // 2 :, 2] = 250
    return SourceTexture("checkers", size, size, True, False, lambda: pixels)


def room(scale: float = 1.0, camera: Camera | None = None, shift: object = (0.0, 0.0, 0.0)) -> SourceScene:
    """A room of 2 units a side times `scale`: texture, instances, metal, glass, a lamp, a spot and a point light."""
    white, red, green, lamp, floor, gold, glass = range(7)
    materials = [
        Material(base_color=(0.73, 0.73, 0.73, 1.0)),
        Material(base_color=(0.63, 0.06, 0.05, 1.0)),
        Material(base_color=(0.14, 0.45, 0.09, 1.0)),
        Material(base_color=(0.3, 0.3, 0.3, 1.0), emissive=(17.0, 12.0, 4.0)),
        Material(base_color_texture=TextureUse(0), roughness=0.6),
        Material(base_color=(0.9, 0.7, 0.3, 1.0), metallic=1.0, roughness=0.25),
        Material(base_color=(0.95, 0.95, 0.95, 1.0), transmission=0.9, roughness=0.05),
    ]
    walls = [
        grid((-1, -1, 1), (2, 0, 0), (0, 0, -2), 4, floor, textured=True),
        grid((-1, 1, -1), (2, 0, 0), (0, 0, 2), 4, white),
        grid((-1, -1, -1), (2, 0, 0), (0, 2, 0), 4, white),
        grid((-1, -1, 1), (0, 0, -2), (0, 2, 0), 4, red),
        grid((1, -1, -1), (0, 0, 2), (0, 2, 0), 4, green),
        grid((-0.3, 0.98, -0.3), (0.6, 0, 0), (0, 0, 0.6), 1, lamp),
    ]
    things = [[ball((0, 0, 0), 1.0, 8, gold, smooth=True)], [ball((0, 0, 0), 1.0, 6, glass)]]
    x, y, z = np.asarray(shift, np.float64)
    whole = moved(x, y, z, scale)
    placed = [
        (0, moved(0, 0, 0)),
        (1, moved(-0.5, -0.7, -0.4, 0.3)),
        (1, moved(0.55, -0.8, -0.5, 0.2, 0.7)),
        (1, moved(0.0, 0.3, -0.7, 0.15, 1.1)),
        (2, moved(0.4, -0.65, 0.2, 0.35)),
        (2, moved(-0.3, -0.85, 0.5, 0.15)),
    ]
    punctual = [
        PunctualLight(kind="point", position=tuple(whole[:3, :3] @ (0.7, 0.5, 0.6) + whole[:3, 3]), color=(0.4 * scale**2,) * 3),
        PunctualLight(
            kind="spot",
            position=tuple(whole[:3, :3] @ (-0.8, 0.9, 0.8) + whole[:3, 3]),
            direction=(0.0, -1.0, 0.0),
            color=(0.0, 0.5 * scale**2, 0.9 * scale**2),
            inner_cone=0.2,
            outer_cone=0.7,
        ),
    ]
    eye = camera or looking(whole[:3, :3] @ (0, 0, 4.2) + whole[:3, 3], whole[:3, 3], yfov=0.64)
    placed = [(mesh, whole @ matrix) for mesh, matrix in placed]
    return scene([walls, *things], materials, [eye], placed=placed, textures=[checkers(150)], punctual=punctual)
