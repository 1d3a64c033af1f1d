"""What a job's image takes of a node's memory, beside what the node holds of the scene (specs/19-jobs.md, Memory). Pure."""

from __future__ import annotations

from scenefold.render.film_rows import row_bytes
from scenefold.render.layers import columns_of, image_bytes

FILMS = 3
"""Of a node among several: its own, the copy of another's, and what comes while films are gathered."""
IMAGE_COPIES = 2
"""Of the image, in memory at the end: its layers, and each of them as bytes. All of these together are its organiser's."""


def image_needs(pixels: int, layers: tuple[str, ...], nodes: int, *, is_adaptive: bool) -> int:
    """Bytes, of each of so many nodes."""
    films = FILMS if nodes > 1 else 1
    return pixels * (films * row_bytes(columns_of(layers)) + is_adaptive) + IMAGE_COPIES * image_bytes(layers, pixels)
