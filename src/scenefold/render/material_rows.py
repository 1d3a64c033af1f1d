"""Materials as rows of numbers, and how they read their textures: two of the arrays that kernels read. Pure."""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F64, Feature, MaterialColumn, TextureUseColumn
from scenefold.scene.payloads.materials import TEXTURE_SLOTS, Material
from scenefold.scene.payloads.texture_uses import TextureUse
from scenefold.scene.tables import SceneTables

USE_COLUMNS = {
    "base_color": MaterialColumn.BASE_USE,
    "metallic_roughness": MaterialColumn.METALLIC_ROUGHNESS_USE,
    "normal": MaterialColumn.NORMAL_USE,
    "occlusion": MaterialColumn.OCCLUSION_USE,
    "emissive": MaterialColumn.EMISSIVE_USE,
    "transmission": MaterialColumn.TRANSMISSION_USE,
    "clearcoat": MaterialColumn.CLEARCOAT_USE,
    "clearcoat_roughness": MaterialColumn.CLEARCOAT_ROUGHNESS_USE,
    "clearcoat_normal": MaterialColumn.CLEARCOAT_NORMAL_USE,
    "specular": MaterialColumn.SPECULAR_USE,
    "specular_color": MaterialColumn.SPECULAR_COLOR_USE,
}
_FACTORS = {
    MaterialColumn.METALLIC: "metallic",
    MaterialColumn.ROUGHNESS: "roughness",
    MaterialColumn.TRANSMISSION: "transmission",
    MaterialColumn.IOR: "ior",
    MaterialColumn.DOUBLE_SIDED: "double_sided",
    MaterialColumn.ALPHA_MODE: "alpha_mode",
    MaterialColumn.ALPHA_CUTOFF: "alpha_cutoff",
    MaterialColumn.UNLIT: "unlit",
    MaterialColumn.NORMAL_SCALE: "normal_scale",
    MaterialColumn.OCCLUSION_STRENGTH: "occlusion_strength",
    MaterialColumn.THICKNESS: "thickness",
    MaterialColumn.ATTENUATION_DISTANCE: "attenuation_distance",
    MaterialColumn.CLEARCOAT: "clearcoat",
    MaterialColumn.CLEARCOAT_ROUGHNESS: "clearcoat_roughness",
    MaterialColumn.CLEARCOAT_NORMAL_SCALE: "clearcoat_normal_scale",
    MaterialColumn.SPECULAR: "specular",
    MaterialColumn.VERTEX_ALPHA: "vertex_alpha",
}
_COLOURS = {
    MaterialColumn.BASE: "base_color",
    MaterialColumn.ATTENUATION_COLOR: "attenuation_color",
    MaterialColumn.SPECULAR_COLOR: "specular_color",
}
assert set(USE_COLUMNS) == set(TEXTURE_SLOTS)
STRAIGHT_ROUGHNESS_MAX = 0.1
"""Thin walls up to this roughness let light pass straight on, which costs no bounce and lets shadow rays through. What they would scatter
(GGX's alpha is 0.01 then) is half a degree, less than can be told behind most panes. By the factor: a texture is not asked."""


def material_rows(tables: SceneTables) -> tuple[F64, F64]:
    """`SceneArrays.materials` and `SceneArrays.texture_uses`: uses that are alike are one row.

    Emission is rounded to f32, as the light table has it. Of an unlit material only the base colour and alpha are left.
    """
    numbers: dict[TextureUse, int] = {}
    rows = np.zeros((max(len(tables.materials), 1), MaterialColumn.WIDTH))
    for row, material in zip(rows, tables.materials, strict=False):
        for column, name in _FACTORS.items():
            row[column] = float(getattr(material, name))
        for column, name in _COLOURS.items():
            colour = getattr(material, name)
            row[column : column + len(colour)] = colour
        row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3] = np.array(material.mean_emissive, np.float32)
        row[MaterialColumn.EMISSIVE : MaterialColumn.EMISSIVE + 3] = np.array(material.emissive, np.float32)
        for slot, column in USE_COLUMNS.items():
            use = material.texture(slot)
            row[column] = -1 if use is None else numbers.setdefault(use, len(numbers))
        row[MaterialColumn.FEATURES] = _features(material)
        if material.unlit:
            row[MaterialColumn.TRANSMISSION] = 0.0
            row[MaterialColumn.EMISSION : MaterialColumn.EMISSION + 3] = row[MaterialColumn.EMISSIVE : MaterialColumn.EMISSIVE + 3] = 0.0
    uses = np.zeros((max(len(numbers), 1), TextureUseColumn.WIDTH))
    for use, number in numbers.items():
        uses[number] = (use.texture, use.wrap_s, use.wrap_t, use.nearest, use.uv_set, *use.transform, use.minify)
    return rows, uses


def _features(material: Material) -> int:
    tints = material.specular != 1.0 or material.specular_color != (1.0, 1.0, 1.0)
    reflects = tints or material.specular_texture is not None or material.specular_color_texture is not None
    mapped = material.normal_texture is not None
    glows = Feature.EMISSIVE_MAP * (material.shines and material.emissive_texture is not None)
    shown = glows | _scattering_through(material) | Feature.NORMAL_MAP * mapped | Feature.COAT * (material.clearcoat > 0.0)
    return Feature.REFLECTION * reflects | Feature.UNLIT * material.unlit | shown


def _scattering_through(material: Material) -> int:
    """How the shader, and not the caster's filter, lets light through it."""
    metal = material.metallic >= 1.0 and material.metallic_roughness_texture is None
    if material.unlit or metal or not material.transmission > 0.0:
        return 0
    if material.thickness > 0.0:
        return Feature.SOLID
    return Feature.ROUGH_TRANSMISSION * (material.roughness > STRAIGHT_ROUGHNESS_MAX)
