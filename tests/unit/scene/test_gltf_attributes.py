"""If these failed, vertices of a glTF would lose colours, tangents or coordinates, or a bad attribute would spoil an image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import SceneArrays
from scenefold.render.content import scene_arrays
from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.plan import ImportPlan
from scenefold.scene.importers.source import MeshPart, SourceScene
from scenefold.scene.layout import GEOMETRY
from scenefold.scene.payloads.geometry import HAS_COLORS, HAS_TANGENTS, HAS_UVS, HAS_UVS2, GeometryAtom, decode_atom
from scenefold.scene.payloads.materials import Material
from scenefold.scene.tables import SceneTables
from unit.scene.gltf_maker import TRIANGLE, Maker, png

UVS = np.array([[0, 0], [1, 0], [0, 1]], "<f4")
FLAT = np.tile(np.array([0, 0, 1], "<f4"), (3, 1))
ALONG = np.tile(np.array([1, 0, 0, -1], "<f4"), (3, 1))
INSTANCING = "EXT_mesh_gpu_instancing"


@pytest.fixture
def maker() -> Maker:
    return Maker()


def part_of(scene: SourceScene) -> MeshPart:
    ((part,),) = scene.meshes
    return part


def atoms_of(plan: ImportPlan) -> list[GeometryAtom]:
    return [decode_atom(item.payload) for item in plan.items() if item.space == GEOMETRY]


def image(maker: Maker) -> int:
    maker.add("images", bufferView=maker.view(png()), mimeType="image/png")
    return maker.add("textures", source=0)


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize(("kind", "largest"), [("<f4", 1), ("u1", 255), ("<u2", 65_535)])
@pytest.mark.parametrize("marked", [True, False])
def test_colours_of_every_type(maker: Maker, tmp_path: Path, width: int, kind: str, largest: int, marked: bool) -> None:
    shares = np.array([[0, 1, 0.2, 0.4], [1, 0.6, 0, 1], [0.8, 0, 1, 0]])[:, :width]
    maker.node(mesh=maker.mesh(attributes={"COLOR_0": np.round(shares * largest, 6).astype(kind)}))
    maker.json["accessors"][0]["normalized"] = marked and kind != "<f4"
    plan = plan_import(read_scene(maker.write(tmp_path)))
    (atom,) = atoms_of(plan)
    assert atom.colors is not None and plan.not_carried == ()
    expected = shares if width == 4 else np.concatenate([shares, np.ones((3, 1))], axis=1)
    assert np.allclose(np.sort(atom.colors, axis=0), np.sort(expected, axis=0), atol=1e-5)


def test_white_colours_are_not_kept_and_odd_ones_are_moved(maker: Maker, tmp_path: Path) -> None:
    maker.node(mesh=maker.mesh(attributes={"COLOR_0": np.ones((3, 3), "<f4")}))
    assert part_of(read_scene(maker.write(tmp_path))).colors is None
    other = Maker()
    other.node(mesh=other.mesh(attributes={"COLOR_0": np.array([[2, 0.5, 0.5], [np.nan, 0, 1], [0, 0, 0]], "<f4")}))
    scene = read_scene(other.write(tmp_path))
    colors = part_of(scene).colors
    assert colors is not None and colors[0].tolist() == [1, 0.5, 0.5, 1] and colors[1].tolist() == [1, 0, 1, 1]
    assert scene.not_carried == ["vertex colours outside 0 to 1, moved to its end (2)"]


def test_vertices_that_hide_something_are_said_by_the_material(maker: Maker, tmp_path: Path) -> None:
    glass = {"alphaMode": "BLEND", "emissiveFactor": [1, 1, 1]}
    maker.add("materials", **glass)
    maker.add("materials", **glass)
    maker.add("materials", emissiveFactor=[1, 1, 1])
    for material, alpha in ((0, 0.5), (1, 1.0), (2, 0.5)):
        colors = np.full((3, 4), alpha, "<f4")
        maker.node(mesh=maker.mesh(material=material, attributes={"COLOR_0": colors}))
    scene = read_scene(maker.write(tmp_path))
    assert [material.vertex_alpha for material in scene.materials] == [True, False, False, False]
    assert [material.is_sampled_light for material in scene.materials] == [False, True, True, False]


def test_two_sets_of_coordinates_with_transforms_of_their_own(maker: Maker, tmp_path: Path) -> None:
    number = image(maker)
    doubled = {"KHR_texture_transform": {"scale": [2, 2]}}
    moved = {"KHR_texture_transform": {"offset": [0.5, 0], "texCoord": 1}}
    maker.add(
        "materials",
        pbrMetallicRoughness={"baseColorTexture": {"index": number, "extensions": doubled}, "metallicRoughnessTexture": {"index": number}},
        normalTexture={"index": number, "texCoord": 0, "extensions": moved},
    )
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": UVS, "TEXCOORD_1": UVS + 3}))
    scene = read_scene(maker.write(tmp_path))
    part, surface = part_of(scene), scene.materials[0]
    # The two that read set 0 differ, so nothing is baked there; the one that reads set 1 is alone.
    assert part.uvs is not None and np.array_equal(part.uvs, UVS)
    assert part.uvs2 is not None and np.array_equal(part.uvs2, UVS + np.array([3.5, 3]))
    uses = dict(surface.uses())
    assert uses["base_color"].transform == (2.0, 0.0, 0.0, 0.0, 2.0, 0.0) and uses["normal"].uv_set == 1
    assert uses["metallic_roughness"].transform == uses["normal"].transform == (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    (atom,) = atoms_of(plan_import(scene))
    assert atom.flags == HAS_UVS | HAS_UVS2


def bumpy(maker: Maker, **node: Any) -> None:
    maker.add("materials", normalTexture={"index": image(maker), "scale": 0.5})
    attributes = {"TEXCOORD_0": UVS, "NORMAL": FLAT, "TANGENT": ALONG}
    maker.node(mesh=maker.mesh(material=0, attributes=attributes), **node)


def test_tangents_turn_with_the_mesh_and_change_sides_in_a_mirror(maker: Maker, tmp_path: Path) -> None:
    bumpy(maker, scale=[-2, 1, 1])
    scene = read_scene(maker.write(tmp_path))
    (atom,) = atoms_of(plan_import(scene))
    assert scene.materials[0].normal_scale == 0.5 and atom.tangents is not None
    assert np.allclose(atom.tangents, [[-1, 0, 0, 1]] * 3)


@pytest.mark.parametrize("bad", [[0, 0, 0, 1], [np.nan, 0, 0, 1], [1, 0, 0, np.inf]])
def test_a_mesh_does_without_tangents_that_are_none(maker: Maker, tmp_path: Path, bad: list[float]) -> None:
    bumpy(maker)
    content = np.frombuffer(maker.data, "<f4").copy() if len(maker.data) % 4 == 0 else None
    assert content is not None
    at = maker.json["bufferViews"][maker.json["accessors"][maker.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"]]["bufferView"]]
    content[at["byteOffset"] // 4 :][:4] = bad
    maker.data = content.tobytes()
    scene = read_scene(maker.write(tmp_path))
    assert part_of(scene).tangents is None and scene.not_carried == ["meshes with tangents that were none (1)"]


def test_what_no_texture_reads_is_not_kept(maker: Maker, tmp_path: Path) -> None:
    attributes = {"TEXCOORD_0": UVS, "NORMAL": FLAT, "TANGENT": ALONG, "_HEAT": np.ones(3, "<f4")}
    maker.node(mesh=maker.mesh(attributes=attributes))
    scene = read_scene(maker.write(tmp_path))
    (atom,) = atoms_of(plan_import(scene))
    assert not atom.flags & (HAS_UVS | HAS_UVS2 | HAS_COLORS | HAS_TANGENTS)
    assert scene.not_carried == ["the vertex attribute _HEAT (1)"]


def test_normals_that_are_none_are_made_anew_and_counted(maker: Maker, tmp_path: Path) -> None:
    maker.node(mesh=maker.mesh(attributes={"NORMAL": np.array([[np.nan, 0, 0], [0, 0, 0], [0, 0, 1]], "<f4")}))
    scene = read_scene(maker.write(tmp_path))
    assert scene.not_carried == ["normals that were none, made anew (2)"]
    (atom,) = atoms_of(plan_import(scene))
    assert atom.normals is not None and np.allclose(atom.normals, FLAT)


def test_an_attribute_of_another_count_is_an_error(maker: Maker, tmp_path: Path) -> None:
    maker.node(mesh=maker.mesh(attributes={"COLOR_0": np.ones((2, 3), "<f4")}))
    with pytest.raises(LocalFault, match="COLOR_0 has 2 elements, but there are 3"):
        read_scene(maker.write(tmp_path))


def test_instances_of_a_file_stay_instances_however_small(maker: Maker, tmp_path: Path) -> None:
    attributes = {"TRANSLATION": maker.accessor(np.array([[0, 0, 0], [0, 0, 5]], "<f4")), "_ID": maker.accessor(np.ones(2, "<f4"))}
    maker.node(mesh=maker.mesh(), extensions={INSTANCING: {"attributes": attributes}})
    plan = plan_import(read_scene(maker.write(tmp_path)))
    assert plan.triangles == 1 and len(atoms_of(plan)) == 1
    assert plan.document().counts["instances"] == 3 and plan.document().counts["instanced_triangles"] == 2
    assert plan.not_carried == ("the instance attribute _ID (1)",)


def test_copies_that_a_transform_leaves_nothing_of_are_counted(maker: Maker, tmp_path: Path) -> None:
    scales = maker.accessor(np.array([[1, 1, 1], [1, 1, 1], [0, 0, 0]], "<f4"))
    maker.node(mesh=maker.mesh(), extensions={INSTANCING: {"attributes": {"SCALE": scales}}})
    plan = plan_import(read_scene(maker.write(tmp_path)))
    assert plan.not_carried == ("triangles without area (1)",) and len(atoms_of(plan)) == 1


@pytest.mark.parametrize("kind", ["spot", "directional"])
def test_a_light_that_loses_its_direction_is_counted(maker: Maker, tmp_path: Path, kind: str) -> None:
    maker.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": kind}, {"type": "point", "range": 4.0}]}}
    maker.node(mesh=maker.mesh())
    for light in (0, 1):
        maker.node(extensions={"KHR_lights_punctual": {"light": light}}, scale=[0, 0, 0])
    scene = read_scene(maker.write(tmp_path))
    assert [(light.kind, light.range) for light in scene.punctual] == [("point", 4.0)]
    assert scene.not_carried == ["lights whose transform leaves them no direction (1)"]


def arrays_of(path: Path) -> SceneArrays:
    plan = plan_import(read_scene(path))
    records = {(item.space, item.location): item.payload for item in plan.items()}
    document = plan.document()
    tables = SceneTables.from_payloads(document, [records[place] for place in document.locations()])
    places = [tables.groups.locations(group) for group in range(len(tables.groups))]
    atoms = {group: tables.group_atoms(group, [records[GEOMETRY, at] for at in found]) for group, found in enumerate(places)}
    return scene_arrays(tables, atoms, {})


def test_arrays_hold_rare_attributes_only_where_something_has_them(tmp_path: Path) -> None:
    plain, coloured = Maker(), Maker()
    plain.node(mesh=plain.mesh())
    coloured.node(mesh=coloured.mesh(TRIANGLE + 1, attributes={"COLOR_0": np.full((3, 4), 0.25, "<f4")}))
    coloured.node(mesh=coloured.mesh())
    bare, full = arrays_of(plain.write(tmp_path, "a.gltf")), arrays_of(coloured.write(tmp_path, "b.gltf"))
    assert (bare.has_uvs2, bare.has_colors, bare.has_tangents) == (False, False, False)
    assert bare.colors.tolist() == [[1, 1, 1, 1]] and bare.uvs2.shape == (1, 2) and bare.tangents.shape == (1, 4)
    assert full.has_colors and not full.has_uvs2
    assert full.colors.shape == (6, 4) and np.allclose(sorted(full.colors[:, 0].tolist()), [0.25] * 3 + [1] * 3, atol=1e-5)
    # The vertices that have colours are those of the first mesh.
    assert (full.vertices[full.colors[:, 0] < 0.5].min(axis=0) >= 1).any()


def test_the_default_material_shines_on_nobody() -> None:
    assert not Material().shines and not Material().textured


def test_copies_that_have_no_volume_once_they_are_rounded_are_baked(maker: Maker, tmp_path: Path) -> None:
    """A shear by 1 + 1e-8 is one by 1 in f32, which has no inverse."""
    mesh = maker.mesh(np.tile(TRIANGLE, (1_001, 1)))
    shear = np.eye(4)
    shear[:2, :2] = [[1, 1 + 1e-8], [1, 1]]
    for matrix in (np.eye(4), np.eye(4), shear):
        maker.node(mesh=mesh, matrix=matrix.T.ravel().tolist())
    plan = plan_import(read_scene(maker.write(tmp_path)))
    list(plan.items())
    assert plan.document().counts["instances"] == 3
