"""What a scene keeps of its file that no renderer here shows yet: said at an import, so that nobody wonders at the image.

Occlusion maps are not among it: they stand for light that surroundings keep away, and a path tracer finds that out itself.
"""

from __future__ import annotations

from scenefold.scene.importers.source import NotCarried, SourceScene


def unshown(source: SourceScene) -> list[str]:
    """One line for each kind of thing, with how many have it."""
    found = NotCarried()
    # KHR_lights_punctual cuts light off there, which no real light does.
    found.note("ranges of punctual lights, kept but not rendered yet", sum(light.range > 0.0 for light in source.punctual))
    return found.lines()
