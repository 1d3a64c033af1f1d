"""What the files of a surface's layers are given of a hit (scattering_kernels.py)."""

from __future__ import annotations

from typing import Any, NamedTuple


class Hit(NamedTuple):
    """In lanes. Vectors are three reals in the world; normals are of length 1 and on the side that is seen."""

    scene: Any
    material: Any
    """Row of `scene.materials`."""
    triangle: Any
    instance: Any
    u: Any
    """Barycentric."""
    v: Any
    places: Any
    """Texture coordinates (surface_kernels.coordinates_at)."""
    surface: Any
    """`Surface`: the material here, with its textures."""
    way: Any
    """Along the ray."""
    geometric: Any
    untilted: Any
    """The shading normal before normal maps."""
    normal: Any
    """The shading normal, with the material's map."""
    behind: Any
    """Whether the triangle is seen from behind."""
    scratch: Any
    """uint32[...] to work in."""
