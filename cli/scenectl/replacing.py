"""What verbs that import a file say of what the scene showed before."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from scenectl.output import counted, note

if TYPE_CHECKING:
    from scenefold.scene.payloads.document import SceneDocument


def tell_replaced(name: str) -> Callable[[SceneDocument], None]:
    """Told of what the scene of this name shows, before anything is stored; says that this goes."""

    def tell(content: SceneDocument) -> None:
        triangles = counted(content.counts.get("triangles", 0), "triangle")
        note(f"note: scene {name} shows {content.source} ({triangles}) already: this import replaces it.")

    return tell


def replaced_text(source: str) -> str:
    """What became of it, afterwards; `source`: the file that it came from."""
    return f"It replaces {source}, whose records stay in the scene and its exports until they are deleted."
