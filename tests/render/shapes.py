"""Meshes, cameras and small scenes: those of the kit that every renderer is tested with."""

from __future__ import annotations

from scenefold.render.kit.shapes import Matrix, Mesh, ball, checkers, grid, looking, moved, part, room, scene

__all__ = ["Matrix", "Mesh", "ball", "checkers", "grid", "looking", "moved", "part", "room", "scene"]
