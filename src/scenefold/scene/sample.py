"""The sample scene that the package ships: a small gallery, made by tools/make_sample_scene.py."""

from __future__ import annotations

from pathlib import Path


def sample_scene_path() -> Path:
    """Where sample.glb lies: about 52,000 triangles with a camera named "main", lit by emissive surfaces."""
    return Path(__file__).parent.parent / "data" / "sample.glb"
