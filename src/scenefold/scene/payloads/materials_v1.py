"""Version 1 of a page of materials, which is read and no longer written (specs/05-scene-content.md).

It had two textures, of base colour and of metallic and roughness, which were read in the same way. An emissive texture's mean
was multiplied into the emission.
"""

from __future__ import annotations

from typing import Any

from scenefold.scene.payloads.texture_uses import TEXTURES_MAX, TextureUse, Wrap
from scenefold.scene.payloads.values import Fields

VERSION = 1
_VALUE_MAX = 1e30


def fields_of(fields: Fields) -> dict[str, Any]:
    """The fields of a `Material`; DamagedData if any is missing or off. `alpha_mode` is a plain number."""
    wraps = [Wrap(fields.integer(key, 0, len(Wrap) - 1)) for key in ("wrap_s", "wrap_t")]
    nearest = fields.flag("nearest")
    textures = {}
    for key in ("base_color_texture", "metallic_roughness_texture"):
        number = fields.integer(key, -1, TEXTURES_MAX)
        textures[key] = TextureUse(number, 0, wraps[0], wraps[1], nearest) if number >= 0 else None
    return {
        "name": fields.text("name"),
        "base_color": fields.numbers("base_color", 4, 0.0, 1.0),
        "metallic": fields.number("metallic", 0.0, 1.0),
        "roughness": fields.number("roughness", 0.0, 1.0),
        "emissive": fields.numbers("emissive", 3, 0.0, _VALUE_MAX),
        "transmission": fields.number("transmission", 0.0, 1.0),
        "ior": fields.number("ior", 1.0, 1e3),
        "double_sided": fields.flag("double_sided"),
        "alpha_mode": fields.integer("alpha_mode", 0, 2),
        "alpha_cutoff": fields.number("alpha_cutoff", 0.0, _VALUE_MAX),
        **textures,
    }
