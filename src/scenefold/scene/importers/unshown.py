"""What a scene keeps of its file that no renderer here shows yet: said at an import, so that nobody wonders at the image."""

from __future__ import annotations

from collections.abc import Callable

from scenefold.scene.importers.source import NotCarried, SourceScene
from scenefold.scene.payloads.materials import Material

_KEPT = ", kept but not rendered yet"
_OF_MATERIALS: dict[str, Callable[[Material], bool]] = {
    "normal maps": lambda one: one.normal_texture is not None or one.clearcoat_normal_texture is not None,
    "occlusion maps": lambda one: one.occlusion_texture is not None,
    "transmission textures": lambda one: one.transmission_texture is not None,
    "clear coats": lambda one: one.clearcoat > 0.0,
    "specular weights and colours": lambda one: (
        one.specular != 1.0
        or one.specular_color != (1.0, 1.0, 1.0)
        or one.specular_texture is not None
        or one.specular_color_texture is not None
    ),
    "insides of glass": lambda one: one.transmission > 0.0 and one.thickness > 0.0,
    "unlit materials": lambda one: one.unlit,
}


def unshown(source: SourceScene) -> list[str]:
    """One line for each kind of thing, with how many materials have it."""
    found = NotCarried()
    for what, has in _OF_MATERIALS.items():
        found.note(what + _KEPT, sum(has(material) for material in source.materials))
    found.note("emissive textures, rendered as their mean", sum(one.emissive_texture is not None for one in source.materials))
    return found.lines()
