"""Materials: what glTF and its extensions can say of a surface (specs/05-scene-content.md).

Colours are linear Rec. 709; `emissive` has its strength multiplied in and is radiance. Where a slot names a texture, what it
holds is multiplied by the factor beside it. Which of its channels counts is glTF's rule: see TEXTURE_SLOTS.

Version 2 of a page leaves out what has its default; version 1 (materials_v1.py) is read, and no longer written.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.payloads import materials_v1
from scenefold.scene.payloads.texture_uses import TextureUse, Wrap, use_of_row
from scenefold.scene.payloads.values import Fields, decode_versions, encode_pages, shorten

__all__ = ["IOR_MAX", "TEXTURE_SLOTS", "VALUE_MAX", "AlphaMode", "Material", "TextureUse", "Wrap", "decode_materials", "encode_materials"]

KIND, VERSION = "materials", 2
VALUE_MAX = 1e30
"""Of radiances, distances and other numbers that have no natural end."""
IOR_MAX = 1e3
Colour = tuple[float, float, float]
_WHITE = (1.0, 1.0, 1.0)

TEXTURE_SLOTS = (
    "base_color",  # red, green, blue; alpha
    "metallic_roughness",  # blue: metallic; green: roughness
    "normal",  # a vector in the tangent space, 0..1 for -1..1
    "occlusion",  # red
    "emissive",  # red, green, blue
    "transmission",  # red
    "clearcoat",  # red
    "clearcoat_roughness",  # green
    "clearcoat_normal",  # as normal
    "specular",  # alpha
    "specular_color",  # red, green, blue
)
"""The textures that a material may have; the field of `Material` has `_texture` behind the name."""


class AlphaMode(IntEnum):
    OPAQUE = 0
    MASK = 1
    BLEND = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: TextureUse | None = None
    metallic: float = 0.0
    roughness: float = 1.0
    metallic_roughness_texture: TextureUse | None = None
    normal_texture: TextureUse | None = None
    normal_scale: float = 1.0
    """Multiplies what a normal map has of x and y."""
    occlusion_texture: TextureUse | None = None
    occlusion_strength: float = 1.0
    emissive: Colour = (0.0, 0.0, 0.0)
    """Radiance, before the texture."""
    emissive_texture: TextureUse | None = None
    emissive_mean: Colour = _WHITE
    """Of the emissive texture, in linear light: by this it counts in the light table."""
    transmission: float = 0.0
    transmission_texture: TextureUse | None = None
    ior: float = 1.5
    thickness: float = 0.0
    """0: a thin wall, which has no inside. Else what is behind the surface is solid; coordinates of the mesh."""
    attenuation_distance: float = math.inf
    """After this way through the inside, in the world's unit, white light has become `attenuation_color`."""
    attenuation_color: Colour = _WHITE
    clearcoat: float = 0.0
    clearcoat_texture: TextureUse | None = None
    clearcoat_roughness: float = 0.0
    clearcoat_roughness_texture: TextureUse | None = None
    clearcoat_normal_texture: TextureUse | None = None
    clearcoat_normal_scale: float = 1.0
    specular: float = 1.0
    specular_texture: TextureUse | None = None
    specular_color: Colour = _WHITE
    """Of the reflection at normal incidence; may pass 1."""
    specular_color_texture: TextureUse | None = None
    unlit: bool = False
    """Shows its base colour, whatever the light."""
    double_sided: bool = False
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    vertex_alpha: bool = False
    """Whether some vertex that wears it has a colour whose alpha is below 1, and alpha counts."""

    def texture(self, slot: str) -> TextureUse | None:
        """How a slot of TEXTURE_SLOTS reads its texture; None: it has none."""
        use: TextureUse | None = getattr(self, f"{slot}_texture")
        return use

    def uses(self) -> Iterator[tuple[str, TextureUse]]:
        """The slots that have a texture, in the order of TEXTURE_SLOTS."""
        for slot in TEXTURE_SLOTS:
            use = self.texture(slot)
            if use is not None:
                yield slot, use

    @property
    def mean_emissive(self) -> Colour:
        """Radiance, with the emissive texture's mean."""
        (red, green, blue), (r, g, b) = self.emissive, self.emissive_mean
        return (red * r, green * g, blue * b) if self.emissive_texture else self.emissive

    @property
    def shines(self) -> bool:
        return not self.unlit and any(channel > 0 for channel in self.mean_emissive)

    @property
    def is_sampled_light(self) -> bool:
        """Whether its triangles stand in the light table: they shine, and alpha hides nothing of them.

        Where alpha is less than 1, and how much, only the texture or the vertices say, which a node that samples lights may not hold.
        """
        alpha = self.base_color[3]
        if self.alpha_mode == AlphaMode.OPAQUE:
            return self.shines
        whole = alpha >= self.alpha_cutoff if self.alpha_mode == AlphaMode.MASK else alpha >= 1.0
        return self.shines and whole and self.base_color_texture is None and not self.vertex_alpha

    @property
    def textured(self) -> bool:
        return any(True for _ in self.uses())


_NOTHING = Material()
_COLOURS = {
    "base_color": (4, 1.0), "emissive": (3, VALUE_MAX), "emissive_mean": (3, 1.0), "attenuation_color": (3, 1.0),
    "specular_color": (3, VALUE_MAX),
}  # fmt: skip
"""How many numbers each has, and the highest of them; the lowest is 0."""
_NUMBERS = {
    "metallic": (0.0, 1.0), "roughness": (0.0, 1.0), "normal_scale": (-VALUE_MAX, VALUE_MAX), "occlusion_strength": (0.0, 1.0),
    "transmission": (0.0, 1.0), "ior": (1.0, IOR_MAX), "thickness": (0.0, VALUE_MAX), "clearcoat": (0.0, 1.0),
    "clearcoat_roughness": (0.0, 1.0), "clearcoat_normal_scale": (-VALUE_MAX, VALUE_MAX), "specular": (0.0, 1.0),
    "alpha_cutoff": (0.0, VALUE_MAX),
}  # fmt: skip
_DISTANCE_MIN = 1e-30
_FLAGS = ("unlit", "double_sided", "vertex_alpha")


def encode_materials(materials: Sequence[Material]) -> list[bytes]:
    """Pages in order."""
    assert len(materials) <= MATERIALS_MAX
    return encode_pages(KIND, VERSION, [_to_map(material) for material in materials])


def decode_materials(payload: bytes) -> tuple[int, list[Material]]:
    """The number of a page's first material, and its materials; DamagedData if anything is off."""
    return decode_versions(payload, KIND, {materials_v1.VERSION: _from_version_1, VERSION: _from_fields})


def _to_map(material: Material) -> dict[str, Any]:
    told: dict[str, Any] = {"name": shorten(material.name)}
    for key, default in _DEFAULTS:
        value = getattr(material, key)
        if value == default:
            continue
        if key in _COLOURS:
            told[key] = [float(number) for number in value]
        elif key in _FLAGS:
            told[key] = bool(value)
        else:
            told[key] = int(value) if key == "alpha_mode" else float(value)
    for slot, use in material.uses():
        told[f"{slot}_texture"] = use.row()
    return told


_DEFAULTS = tuple((key, getattr(_NOTHING, key)) for key in (*_COLOURS, *_NUMBERS, *_FLAGS, "attenuation_distance", "alpha_mode"))


def _from_fields(fields: Fields) -> Material:
    found: dict[str, Any] = {"name": fields.text("name")}
    for key, (count, high) in _COLOURS.items():
        if fields.has(key):
            found[key] = fields.numbers(key, count, 0.0, high)
    for key, (low, high) in _NUMBERS.items():
        if fields.has(key):
            found[key] = fields.number(key, low, high)
    for key in _FLAGS:
        if fields.has(key):
            found[key] = fields.flag(key)
    if fields.has("attenuation_distance"):
        found["attenuation_distance"] = fields.number("attenuation_distance", _DISTANCE_MIN, VALUE_MAX)
    if fields.has("alpha_mode"):
        found["alpha_mode"] = AlphaMode(fields.integer("alpha_mode", 0, len(AlphaMode) - 1))
    for slot in TEXTURE_SLOTS:
        if fields.has(f"{slot}_texture"):
            found[f"{slot}_texture"] = use_of_row(fields, f"{slot}_texture")
    return Material(**found)


def _from_version_1(fields: Fields) -> Material:
    found = materials_v1.fields_of(fields)
    return Material(**found | {"alpha_mode": AlphaMode(found["alpha_mode"])})
