"""Materials: glTF metallic-roughness with emission, transmission and alpha (specs/05-scene-content.md).

Colours are linear Rec. 709, `emissive` has its strength multiplied in and is radiance. A texture is named by
its number in the texture table, -1 is none. Wrap modes and `nearest` belong to the material's textures (its
base-colour texture's sampler decides).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from scenefold.base.limits import MATERIALS_MAX
from scenefold.scene.payloads.values import Fields, decode_page, encode_pages, shorten

KIND, VERSION = "materials", 1
_TEXTURES_MAX = 2**31
_VALUE_MAX = 1e30


class AlphaMode(IntEnum):
    OPAQUE = 0
    MASK = 1
    BLEND = 2


class Wrap(IntEnum):
    """What lies outside 0 to 1 of texture coordinates."""

    REPEAT = 0
    CLAMP = 1
    MIRROR = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    base_color_texture: int = -1
    metallic: float = 0.0
    roughness: float = 1.0
    metallic_roughness_texture: int = -1
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    transmission: float = 0.0
    ior: float = 1.5
    double_sided: bool = False
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    wrap_s: Wrap = Wrap.REPEAT
    wrap_t: Wrap = Wrap.REPEAT
    nearest: bool = False

    @property
    def shines(self) -> bool:
        return any(channel > 0 for channel in self.emissive)

    @property
    def is_sampled_light(self) -> bool:
        """Whether its triangles stand in the light table: they shine, and alpha hides nothing of them.

        Where alpha is less than 1, and how much, only the texture says, which a node that samples lights may not hold.
        """
        alpha = self.base_color[3]
        if self.alpha_mode == AlphaMode.OPAQUE:
            return self.shines
        whole = alpha >= self.alpha_cutoff if self.alpha_mode == AlphaMode.MASK else alpha >= 1.0
        return self.shines and whole and self.base_color_texture < 0

    @property
    def textured(self) -> bool:
        return self.base_color_texture >= 0 or self.metallic_roughness_texture >= 0


def encode_materials(materials: Sequence[Material]) -> list[bytes]:
    """Pages in order."""
    assert len(materials) <= MATERIALS_MAX
    return encode_pages(KIND, VERSION, [_to_map(material) for material in materials])


def decode_materials(payload: bytes) -> tuple[int, list[Material]]:
    """The number of a page's first material, and its materials; DamagedData if anything is off."""
    return decode_page(payload, KIND, VERSION, _from_fields)


def _to_map(material: Material) -> dict[str, Any]:
    return {
        "name": shorten(material.name),
        "base_color": [float(value) for value in material.base_color],
        "base_color_texture": material.base_color_texture,
        "metallic": float(material.metallic),
        "roughness": float(material.roughness),
        "metallic_roughness_texture": material.metallic_roughness_texture,
        "emissive": [float(value) for value in material.emissive],
        "transmission": float(material.transmission),
        "ior": float(material.ior),
        "double_sided": material.double_sided,
        "alpha_mode": int(material.alpha_mode),
        "alpha_cutoff": float(material.alpha_cutoff),
        "wrap_s": int(material.wrap_s),
        "wrap_t": int(material.wrap_t),
        "nearest": material.nearest,
    }


def _from_fields(fields: Fields) -> Material:
    red, green, blue, alpha = fields.numbers("base_color", 4, 0.0, 1.0)
    emissive = fields.numbers("emissive", 3, 0.0, _VALUE_MAX)
    return Material(
        name=fields.text("name"),
        base_color=(red, green, blue, alpha),
        base_color_texture=fields.integer("base_color_texture", -1, _TEXTURES_MAX),
        metallic=fields.number("metallic", 0.0, 1.0),
        roughness=fields.number("roughness", 0.0, 1.0),
        metallic_roughness_texture=fields.integer("metallic_roughness_texture", -1, _TEXTURES_MAX),
        emissive=(emissive[0], emissive[1], emissive[2]),
        transmission=fields.number("transmission", 0.0, 1.0),
        ior=fields.number("ior", 1.0, 1e3),
        double_sided=fields.flag("double_sided"),
        alpha_mode=AlphaMode(fields.integer("alpha_mode", 0, len(AlphaMode) - 1)),
        alpha_cutoff=fields.number("alpha_cutoff", 0.0, _VALUE_MAX),
        wrap_s=Wrap(fields.integer("wrap_s", 0, len(Wrap) - 1)),
        wrap_t=Wrap(fields.integer("wrap_t", 0, len(Wrap) - 1)),
        nearest=fields.flag("nearest"),
    )
