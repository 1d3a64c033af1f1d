"""If these failed, surfaces of a glTF would come in with other numbers than it says, or a strange number would spoil an image."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.payloads.materials import Material, TextureUse
from scenefold.scene.payloads.texture_uses import Wrap
from unit.scene.gltf_maker import Maker, png

CLAMPED = "material factors outside their range, moved to its end"


def scene_with(folder: Path, *materials: dict[str, Any], textures: int = 3) -> SourceScene:
    maker = Maker()
    for number in range(textures):
        maker.add("images", bufferView=maker.view(png((number, 0, 0, 255))), mimeType="image/png")
        maker.add("textures", source=number, sampler=number)
        maker.add("samplers", wrapS=(10497, 33071, 33648)[number % 3], magFilter=9728 + number % 2)
    for material in materials:
        maker.add("materials", **material)
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")}))
    return read_scene(maker.write(folder))


def material_with(folder: Path, **material: Any) -> Material:
    return scene_with(folder, material).materials[0]


def test_every_slot_has_its_texture_and_sampler(tmp_path: Path) -> None:
    def info(number: int) -> dict[str, Any]:
        return {"index": number}

    coat = {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25, "clearcoatTexture": info(0), "clearcoatRoughnessTexture": info(1)}
    scene = scene_with(
        tmp_path,
        {
            "pbrMetallicRoughness": {"baseColorTexture": info(0), "metallicRoughnessTexture": info(1)},
            "normalTexture": info(2) | {"scale": -0.5},
            "occlusionTexture": info(1) | {"strength": 0.25},
            "emissiveTexture": info(0),
            "emissiveFactor": [1, 1, 1],
            "extensions": {
                "KHR_materials_clearcoat": coat | {"clearcoatNormalTexture": info(2) | {"scale": 2.0}},
                "KHR_materials_transmission": {"transmissionFactor": 0.75, "transmissionTexture": info(1)},
                "KHR_materials_specular": {
                    "specularFactor": 0.5,
                    "specularTexture": info(0),
                    "specularColorFactor": [1, 2, 0.5],
                    "specularColorTexture": info(0),
                },
                "KHR_materials_volume": {"thicknessFactor": 0.1, "attenuationDistance": 2.0, "attenuationColor": [0.5, 1, 0]},
                "KHR_materials_ior": {"ior": 1.33},
            },
        },
    )
    surface = scene.materials[0]
    uses = dict(surface.uses())
    assert len(uses) == 11 and scene.not_carried == []
    # Alpha has no coding, so the specular texture is the image that the colours already are.
    assert uses["base_color"] == uses["emissive"] == uses["specular"] == uses["specular_color"]
    names = {slot: (scene.textures[use.texture].name, scene.textures[use.texture].srgb) for slot, use in uses.items()}
    assert names["base_color"] == ("image 0", True) and names["clearcoat"] == ("image 0", False)
    assert names["normal"] == names["clearcoat_normal"] == ("image 2", False)
    assert {use.wrap_s for slot, use in uses.items() if slot in ("metallic_roughness", "occlusion")} == {Wrap.CLAMP}
    assert uses["normal"].wrap_s is Wrap.MIRROR and uses["normal"].nearest and not uses["occlusion"].nearest
    assert (surface.normal_scale, surface.occlusion_strength, surface.clearcoat_normal_scale) == (-0.5, 0.25, 2.0)
    assert (surface.clearcoat, surface.clearcoat_roughness, surface.transmission, surface.ior) == (0.5, 0.25, 0.75, 1.33)
    assert (surface.specular, surface.specular_color) == (0.5, (1.0, 2.0, 0.5))
    assert (surface.thickness, surface.attenuation_distance, surface.attenuation_color) == (0.1, 2.0, (0.5, 1.0, 0.0))


def test_what_a_factor_of_nothing_hides_keeps_no_image(tmp_path: Path) -> None:
    texture = {"index": 0}
    extensions = {
        "KHR_materials_clearcoat": {"clearcoatTexture": texture},
        "KHR_materials_transmission": {"transmissionTexture": texture},
    }
    scene = scene_with(tmp_path, {"emissiveTexture": texture, "extensions": extensions})
    assert scene.textures == [] and not scene.materials[0].textured


def test_defaults_of_extensions(tmp_path: Path) -> None:
    names = ("clearcoat", "transmission", "specular", "volume", "ior", "unlit", "emissive_strength")
    surface = material_with(tmp_path, extensions={f"KHR_materials_{name}": {} for name in names})
    assert surface == Material(name="material 0", metallic=1.0, unlit=True)
    assert surface.attenuation_distance == math.inf


def test_numbers_outside_their_range_are_moved_and_counted(tmp_path: Path) -> None:
    scene = scene_with(
        tmp_path,
        {
            "pbrMetallicRoughness": {"roughnessFactor": -2.0, "metallicFactor": 1.5, "baseColorFactor": [-1, 0.5, 2, 1]},
            "extensions": {
                "KHR_materials_ior": {"ior": 0.5},
                "KHR_materials_volume": {"attenuationDistance": 0.0, "thicknessFactor": -1},
                "KHR_materials_clearcoat": {"clearcoatFactor": 3},
                "KHR_materials_specular": {"specularColorFactor": [-1, 0, 0]},
            },
        },
        {"extensions": {"KHR_materials_ior": {"ior": 0}}},
    )
    surface, metal = scene.materials[:2]
    assert (surface.roughness, surface.metallic, surface.base_color) == (0.0, 1.0, (0.0, 0.5, 1.0, 1.0))
    assert (surface.ior, surface.thickness, surface.clearcoat, surface.specular_color) == (1.0, 0.0, 1.0, (0.0, 0.0, 0.0))
    assert surface.attenuation_distance == math.inf and metal.ior == 1.5
    assert scene.not_carried == [
        "attenuation distances that are none (1)",
        "indices of refraction of 0, taken for 1.5 (1)",
        f"{CLAMPED} (7)",
    ]
    list(plan_import(scene).items())


def test_specular_glossiness_is_approximated_and_said(tmp_path: Path) -> None:
    glossy = {"diffuseFactor": [0.5, 0.5, 0.5, 1], "specularFactor": [0.08, 0.04, 0.0], "glossinessFactor": 0.75}
    textures = {"diffuseTexture": {"index": 0}, "specularGlossinessTexture": {"index": 1}}
    scene = scene_with(tmp_path, {"extensions": {"KHR_materials_pbrSpecularGlossiness": glossy | textures}})
    surface = scene.materials[0]
    assert (surface.metallic, surface.roughness, surface.base_color[0]) == (0.0, 0.25, 0.5)
    assert surface.specular_color == pytest.approx((2.0, 1.0, 0.0))
    assert [slot for slot, _ in surface.uses()] == ["base_color", "specular_color"]
    assert scene.not_carried == ["glossiness textures (1)", "specular-glossiness materials, approximated (1)"]


def test_specular_glossiness_beside_metallic_roughness_is_left_and_said(tmp_path: Path) -> None:
    extensions = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 1, 0, 1], "diffuseTexture": {"index": 0}}}
    scene = scene_with(tmp_path, {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}, "extensions": extensions})
    assert scene.materials[0].base_color == (1.0, 0.0, 0.0, 1.0) and not scene.materials[0].textured
    assert scene.not_carried == ["specular-glossiness beside metallic-roughness, which was taken (1)"]


def test_specular_glossiness_counts_where_metallic_roughness_says_nothing(tmp_path: Path) -> None:
    extensions = {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 1, 0, 1]}}
    scene = scene_with(tmp_path, {"pbrMetallicRoughness": {}, "extensions": extensions})
    assert scene.materials[0].base_color == (0.0, 1.0, 0.0, 1.0)
    assert scene.not_carried == ["specular-glossiness materials, approximated (1)"]


def test_what_is_left_behind_is_said(tmp_path: Path) -> None:
    transform = {"texCoord": 2}
    scene = scene_with(
        tmp_path,
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
            "normalTexture": {"index": 1, "texCoord": 1},
            "occlusionTexture": {"index": 2, "extensions": {"KHR_texture_transform": transform}},
            "extensions": {"KHR_materials_volume": {"thicknessTexture": {"index": 0}}, "KHR_materials_iridescence": {}},
        },
    )
    assert scene.materials[0].base_color_texture == TextureUse(0, nearest=True) and scene.materials[0].occlusion_texture is None
    assert scene.not_carried == [
        "material extension KHR_materials_iridescence (1)",
        "textures on meshes without texture coordinates (1)",
        "textures that read a third set of coordinates (1)",
        "thickness textures (1)",
    ]


@pytest.mark.parametrize(
    ("factor", "strength", "emission"),
    [
        ([0, -1, 0.5], 2.0, (0.0, 0.0, 1.0)),
        ([0, 1, 0], -1.0, (0.0, 0.0, 0.0)),
        ([1, 0, 0.5], 1e20, (1e12, 0.0, 1e12)),
        ([1e300, 0, 0], 1e-24, (1e6, 0.0, 0.0)),
    ],
)
def test_an_emission_outside_its_range_is_moved_to_its_end(
    tmp_path: Path, factor: list[float], strength: float, emission: tuple[float, float, float]
) -> None:
    extensions = {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    scene = scene_with(tmp_path, {"emissiveFactor": factor, "extensions": extensions})
    assert scene.materials[0].emissive == pytest.approx(emission)
    assert scene.not_carried == ["material factors outside their range, moved to its end (1)"]
    list(plan_import(scene).items())


def test_lamps_without_area_or_light_are_no_rows_of_the_light_table(tmp_path: Path) -> None:
    maker = Maker()
    maker.add("images", bufferView=maker.view(png((0, 0, 0, 255))), mimeType="image/png")
    maker.add("textures", source=0)
    maker.add("materials", emissiveFactor=[1, 1, 1])
    maker.add("materials", emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0})
    black = maker.mesh(material=1, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")})
    flat = maker.mesh(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), material=0)
    for mesh in (maker.mesh(material=0), flat, black):
        maker.node(mesh=mesh)
    plan = plan_import(read_scene(maker.write(tmp_path)))
    list(plan.items())
    assert plan.document().counts["lights"] == 1
    assert plan.not_carried == ("triangles without area (1)",)
