"""If these failed, surfaces of other people's files would not be what their makers said. Uses ../shared/scenes where that exists."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.payloads.materials import Material, Wrap
from scenefold.scene.payloads.texture_uses import IDENTITY

SCENES = Path(__file__).parents[3].parent / "shared" / "scenes"

pytestmark = pytest.mark.skipif(not SCENES.is_dir(), reason="the shared scenes are not here")


def scene_of(name: str) -> SourceScene:
    path = SCENES / name
    if not path.is_file():
        pytest.skip(f"{name} is not here")
    return read_scene(path)


def by_name(scene: SourceScene) -> dict[str, Material]:
    return {material.name: material for material in scene.materials}


def test_clearcoats_keep_their_maps() -> None:
    scene = scene_of("ClearCoatTest/ClearCoatTest.glb")
    coats = [material for material in scene.materials if material.clearcoat > 0]
    slots = {slot for material in coats for slot, _ in material.uses()}
    assert len(coats) > 5 and {"clearcoat", "clearcoat_roughness", "clearcoat_normal", "normal"} <= slots
    assert scene.not_carried == []


def test_transmission_keeps_its_textures() -> None:
    scene = scene_of("TransmissionTest/TransmissionTest.glb")
    clear = [material for material in scene.materials if material.transmission > 0]
    assert len(clear) > 5 and any(material.transmission_texture for material in clear)
    assert scene.not_carried == ["extension KHR_xmp (1)"]


def test_emission_keeps_its_strength() -> None:
    scene = scene_of("EmissiveStrengthTest/EmissiveStrengthTest.glb")
    strengths = sorted(max(material.emissive) for material in scene.materials if material.shines)
    assert strengths == pytest.approx([0.9 * 2**step for step in range(5)]) and scene.not_carried == []


def test_texture_transforms_are_baked_where_a_material_has_one_texture() -> None:
    scene = scene_of("TextureTransformTest/TextureTransformTest.gltf")
    uses = [use for material in scene.materials for _, use in material.uses()]
    assert len(uses) == 9 and all(use.transform == IDENTITY for use in uses)
    assert any(use.wrap_s is Wrap.REPEAT for use in uses) and scene.not_carried == []


def test_instances_are_records() -> None:
    plan = plan_import(scene_of("SimpleInstancing/SimpleInstancing.glb"))
    for _ in plan.items():
        pass
    counts = plan.document().counts
    assert (counts["instances"], counts["triangles"], counts["instanced_triangles"]) == (126, 12, 1_500)


def test_the_smallest_textured_file() -> None:
    scene = scene_of("BoxTextured/BoxTextured.glb")
    assert scene.materials[0].base_color_texture is not None and len(scene.textures) == 1 and scene.not_carried == []
