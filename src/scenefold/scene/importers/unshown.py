"""What a scene keeps of its file that no renderer here shows yet: said at an import, so that nobody wonders at the image.

Occlusion maps are not among it: they stand for light that surroundings keep away, and a path tracer finds that out itself.
"""

from __future__ import annotations

from collections.abc import Callable

from scenefold.scene.importers.source import NotCarried, SourceScene
from scenefold.scene.payloads.materials import Material

_KEPT = ", kept but not rendered yet"
_OF_MATERIALS: dict[str, Callable[[Material], bool]] = {
    "insides of glass": lambda one: one.transmission > 0.0 and one.thickness > 0.0,
}


def unshown(source: SourceScene) -> list[str]:
    """One line for each kind of thing, with how many materials or lights have it."""
    found = NotCarried()
    for what, has in _OF_MATERIALS.items():
        found.note(what + _KEPT, sum(has(material) for material in source.materials))
    # KHR_lights_punctual cuts light off there, which no real light does.
    found.note("ranges of punctual lights" + _KEPT, sum(light.range > 0.0 for light in source.punctual))
    return found.lines()
