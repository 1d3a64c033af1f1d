"""If this fails, an import is silent on what the image will not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenefold.scene.importers.source import MeshPart, SourceScene
from scenefold.scene.importers.unshown import unshown
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight
from scenefold.scene.payloads.texture_uses import TextureUse

CORNERS = np.eye(3, dtype=np.float32)


def scene(*materials: Material, colors: bool = False) -> SourceScene:
    part = MeshPart(CORNERS, None, None, np.array([[0, 1, 2]], np.uint32), 0, colors=np.ones((3, 4), np.float32) if colors else None)
    return SourceScene("a", [[part]], np.zeros(1, np.int64), np.eye(4)[None], list(materials))


def test_what_is_rendered_is_not_named() -> None:
    turned = TextureUse(1, transform=(2.0, 0.0, 0.0, 0.0, 2.0, 0.0))
    plain = Material(base_color_texture=TextureUse(0), metallic_roughness_texture=turned, emissive=(1.0, 2.0, 3.0), transmission=0.5)
    coated = Material(clearcoat_normal_texture=TextureUse(0), clearcoat=1.0)
    mapped = Material(normal_texture=TextureUse(0), occlusion_texture=TextureUse(0), emissive_texture=TextureUse(0))
    solid = Material(transmission=1.0, thickness=0.1, attenuation_distance=2.0, attenuation_color=(0.5, 0.5, 0.5), specular=0.5)
    assert unshown(scene(Material(), plain, coated, mapped, solid, colors=True)) == []


def test_where_a_light_is_cut_off_is_kept_only() -> None:
    lamps = [PunctualLight(kind="point", color=(1.0, 1.0, 1.0), range=reach) for reach in (0.0, 5.0, 2.0)]
    assert unshown(replace(scene(Material()), punctual=lamps)) == ["ranges of punctual lights, kept but not rendered yet (2)"]
