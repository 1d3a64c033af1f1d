"""If these failed, a glTF would come into the store changed, or a bad one would not be told clearly."""

from __future__ import annotations

import json
import math
import os
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.payloads.materials import AlphaMode, TextureUse, Wrap
from scenefold.scene.payloads.texture_uses import Minify
from unit.scene.gltf_maker import TRIANGLE, Maker, png


@pytest.fixture
def maker() -> Maker:
    return Maker()


def triangles_in_world(path: Path) -> np.ndarray:  # type: ignore[type-arg]
    """f32[n, 3, 3] of everything that is placed, without merging."""
    scene = read_scene(path)
    found = []
    for mesh, matrix in zip(scene.placed_meshes, scene.placed_matrices, strict=True):
        for part in scene.meshes[mesh]:
            moved = part.positions @ matrix[:3, :3].T + matrix[:3, 3]
            found.append(moved[part.triangles])
    return np.concatenate(found)


def test_node_transforms_multiply_down_the_tree(maker: Maker, tmp_path: Path) -> None:
    child = maker.node(root=False, mesh=maker.mesh(), scale=[2, 2, 2])
    quarter = [0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4)]
    maker.node(children=[child], translation=[10, 0, 0], rotation=quarter)
    expected = [[10, 0, 0], [10, 2, 0], [8, 0, 0]]
    assert np.allclose(triangles_in_world(maker.write(tmp_path))[0], expected, atol=1e-6)


def test_a_matrix_is_stored_column_by_column(maker: Maker, tmp_path: Path) -> None:
    maker.node(mesh=maker.mesh(), matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1])
    assert np.array_equal(triangles_in_world(maker.write(tmp_path))[0], TRIANGLE + np.array([5, 6, 7]))


@pytest.mark.parametrize(("mode", "count"), [(4, 2), (5, 4), (6, 4)])
def test_strips_and_fans_become_triangles_of_one_side(maker: Maker, tmp_path: Path, mode: int, count: int) -> None:
    strip = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]]
    fan = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 1, 0], [-1, 0, 0]]
    maker.node(mesh=maker.mesh(fan if mode == 6 else strip, mode=mode))
    found = triangles_in_world(maker.write(tmp_path))
    assert len(found) == count
    if mode != 4:
        crosses = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
        assert (crosses[:, 2] > 0).all()


def test_sparse_interleaved_and_normalised_accessors(maker: Maker, tmp_path: Path) -> None:
    changed = maker.accessor(np.array([2], "u1"))
    values = maker.accessor(np.array([[0, 9, 0]], "<f4"))
    views = [maker.json["accessors"][number]["bufferView"] for number in (changed, values)]
    sparse = {
        "count": 1,
        "indices": {"bufferView": views[0], "componentType": 5121},
        "values": {"bufferView": views[1]},
    }
    interleaved = np.zeros((3, 5), "<f4")
    interleaved[:, :3], interleaved[:, 3:] = TRIANGLE, [[0, 0], [1, 0], [0, 1]]
    view = maker.view(interleaved.tobytes())
    maker.json["bufferViews"][view]["byteStride"] = 20
    position = maker.add("accessors", bufferView=view, componentType=5126, count=3, type="VEC3", sparse=sparse)
    maker.add("meshes", primitives=[{"attributes": {"POSITION": position}}])
    maker.node(mesh=0)
    assert np.array_equal(triangles_in_world(maker.write(tmp_path))[0], [[0, 0, 0], [1, 0, 0], [0, 9, 0]])


def test_gpu_instances_are_placed(maker: Maker, tmp_path: Path) -> None:
    places = maker.accessor(np.array([[0, 0, 0], [0, 0, 5]], "<f4"))
    scales = maker.accessor(np.array([[1, 1, 1], [2, 2, 2]], "<f4"))
    attributes = {"TRANSLATION": places, "SCALE": scales}
    maker.node(mesh=maker.mesh(), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    found = triangles_in_world(maker.write(tmp_path))
    assert np.array_equal(found[1], TRIANGLE * 2 + [0, 0, 5])


def test_materials_samplers_and_textures(maker: Maker, tmp_path: Path) -> None:
    (tmp_path / "wood.png").write_bytes(png((188, 188, 188, 128)))
    maker.add("images", uri="wood.png")
    maker.add("samplers", wrapS=33071, wrapT=33648, magFilter=9728)
    maker.add("textures", source=0, sampler=0)
    emission = {"KHR_materials_emissive_strength": {"emissiveStrength": 4.0}, "KHR_materials_sheen": {}}
    maker.add(
        "materials", name="wood", alphaMode="MASK", alphaCutoff=0.25, doubleSided=True, emissiveFactor=[1, 0.5, 0],
        emissiveTexture={"index": 0}, extensions=emission, normalTexture={"index": 0},
        pbrMetallicRoughness={"baseColorTexture": {"index": 0}, "metallicFactor": 0.25},
    )  # fmt: skip
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")}))
    scene = read_scene(maker.write(tmp_path))
    wood = scene.materials[0]
    use = TextureUse(0, 0, Wrap.CLAMP, Wrap.MIRROR, True)
    assert (wood.alpha_mode, wood.alpha_cutoff, wood.double_sided) == (AlphaMode.MASK, 0.25, True)
    assert wood.metallic == 0.25 and wood.roughness == 1.0 and wood.base_color_texture == use
    assert wood.emissive == (4.0, 2.0, 0.0) and wood.emissive_texture == use
    assert wood.mean_emissive == pytest.approx((2.0, 1.0, 0.0), abs=0.03)
    assert scene.textures[0].has_alpha and scene.textures[0].srgb
    # The same image means something else where it is no colour.
    assert wood.normal_texture == replace(use, texture=1) and not scene.textures[1].srgb
    assert scene.not_carried == ["material extension KHR_materials_sheen (1)"]


def test_cameras_keep_their_names_and_lose_their_scale(maker: Maker, tmp_path: Path) -> None:
    maker.add("cameras", type="perspective", perspective={"yfov": 0.5, "znear": 0.1, "aspectRatio": 2.0})
    maker.add("cameras", type="orthographic", orthographic={"xmag": 4.0, "ymag": 2.0, "znear": 0.0, "zfar": 9.0})
    maker.node(mesh=maker.mesh())
    maker.node(camera=0, name="close", scale=[3, 3, 3], translation=[0, 0, 4])
    maker.node(camera=1, name="close")
    cameras = read_scene(maker.write(tmp_path)).cameras
    assert [camera.name for camera in cameras] == ["close", "close 2"]
    assert np.allclose(cameras[0].matrix[:3, :3], np.eye(3)) and cameras[0].matrix[2, 3] == 4
    assert cameras[1].ymag == 2.0 and cameras[1].aspect == 2.0


def test_punctual_lights_stand_in_the_world(maker: Maker, tmp_path: Path) -> None:
    lights = [{"type": "spot", "intensity": 3.0, "color": [1, 0.5, 0], "spot": {"innerConeAngle": 0.1, "outerConeAngle": 0.2}}]
    maker.json["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    turn = [-math.sin(math.pi / 4), 0, 0, math.cos(math.pi / 4)]
    maker.node(mesh=maker.mesh())
    maker.node(extensions={"KHR_lights_punctual": {"light": 0}}, rotation=turn, translation=[1, 2, 3])
    (light,) = read_scene(maker.write(tmp_path)).punctual
    assert light.direction == pytest.approx((0, -1, 0)) and light.position == (1, 2, 3)
    assert light.color == (3.0, 1.5, 0.0) and light.outer_cone == 0.2


def bad(name: str) -> Callable[[Callable[[Maker], None]], Callable[[Maker], None]]:
    def keep(change: Callable[[Maker], None]) -> Callable[[Maker], None]:
        BAD[name] = change
        return change

    return keep


BAD: dict[str, Callable[[Maker], None]] = {}


@bad("index 7, but 3 vertices")
def _index(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(indices=np.array([0, 1, 7], "<u2")))


@bad("finite corners")
def _nan(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(np.array([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]])))


@bad("beyond 1e9")
def _far(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(), scale=[1e8, 1, 1], children=[])
    maker.json["nodes"][0]["translation"] = [9.9e8, 0, 0]


@bad("is missing")
def _texture(maker: Maker) -> None:
    maker.add("images", uri="lost.png")
    maker.add("textures", source=0)
    maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    maker.node(mesh=maker.mesh(material=0))


@bad("no path relative")
def _texture_elsewhere(maker: Maker) -> None:
    _texture(maker)
    maker.json["images"][0]["uri"] = "/etc/hostname"


@bad("pixels, over")
def _texture_bomb(maker: Maker) -> None:
    _texture(maker)
    header = bytearray(png())
    struct.pack_into(">II", header, 16, 12_000, 12_000)
    import zlib

    struct.pack_into(">I", header, 29, zlib.crc32(bytes(header[12:29])))
    maker.json["images"][0] = {"bufferView": maker.view(bytes(header)), "mimeType": "image/png"}


def _with_camera(maker: Maker, **node: object) -> None:
    maker.add("cameras", type="perspective", perspective={"yfov": 0.5, "znear": 0.1})
    maker.node(mesh=maker.mesh())
    maker.node(camera=0, **node)


@bad("reached twice")
def _cycle(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(), children=[0])


@bad("names mesh 4, but there are 1")
def _mesh(maker: Maker) -> None:
    maker.mesh()
    maker.node(mesh=4)


@bad("of a view of 36 bytes")
def _claim(maker: Maker) -> None:
    maker.node(mesh=maker.mesh())
    maker.json["accessors"][0]["count"] = 4_000_000_000


@bad("without data")
def _claim_without_data(maker: Maker) -> None:
    maker.node(mesh=maker.mesh())
    maker.json["accessors"][0] = {"componentType": 5126, "count": 4_000_000_000, "type": "VEC3"}


@bad("more triangles than it has bytes")
def _shared_a_thousand_times(maker: Maker) -> None:
    mesh = maker.mesh(np.random.default_rng(1).random((300, 3)), np.zeros(60_000, "u1"))
    maker.json["meshes"][mesh]["primitives"] *= 40
    maker.node(mesh=mesh)


@bad("empty")
def _nothing(maker: Maker) -> None:
    maker.node(name="alone")


@bad("no triangle")
def _no_area(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(np.zeros((3, 3))))


@bad("which scenefold does not read")
def _extension(maker: Maker) -> None:
    maker.node(mesh=maker.mesh())
    maker.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]


@bad("scenefold reads glTF 2")
def _version(maker: Maker) -> None:
    maker.json["asset"]["version"] = "1.0"


@pytest.mark.parametrize("words", BAD)
def test_a_bad_file_gives_one_clear_error(maker: Maker, tmp_path: Path, words: str) -> None:
    BAD[words](maker)
    with pytest.raises(LocalFault) as caught:
        plan_import(read_scene(maker.write(tmp_path)))
    line = str(caught.value)
    assert words.strip() in line and "\n" not in line and "test.gltf" in line and caught.value.remedy


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, '{"asset":{"version":"2.0"},"nodes":5}', "1" * 5_000])
def test_text_that_is_no_gltf(tmp_path: Path, text: str) -> None:
    path = tmp_path / "odd.gltf"
    path.write_text(text)
    with pytest.raises(LocalFault):
        plan_import(read_scene(path))


def test_any_cut_or_changed_glb_is_read_or_refused(maker: Maker, tmp_path: Path) -> None:
    _with_camera(maker)
    maker.json["buffers"] = [{"byteLength": len(maker.data)}]
    text = json.dumps(maker.json).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(maker.data), 0x004E4942) + maker.data
    whole = struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
    path = tmp_path / "t.glb"
    path.write_bytes(whole)
    assert plan_import(read_scene(path)).triangles == 1
    dice = np.random.default_rng(7)
    for _ in range(300):
        damaged = bytearray(whole[: dice.integers(0, len(whole)) if dice.random() < 0.3 else len(whole)])
        for _ in range(dice.integers(1, 4)):
            if damaged:
                damaged[dice.integers(0, len(damaged))] = dice.integers(0, 256)
        path.unlink()
        path.write_bytes(damaged)
        try:
            list(plan_import(read_scene(path)).items())
        except LocalFault:
            continue


def test_what_is_no_regular_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.glb")
    (tmp_path / "text.docx").write_text("a")
    for name in ("pipe.glb", "text.docx", "lost.glb", ".", "a\0b.glb"):
        with pytest.raises(LocalFault):
            read_scene(tmp_path / name)


@pytest.mark.parametrize(
    ("min_filter", "minify"),
    [
        ({}, Minify.LINEAR_BETWEEN),
        ({"minFilter": 9728}, Minify.FINEST),
        ({"minFilter": 9729}, Minify.FINEST),
        ({"minFilter": 9984}, Minify.NEAREST_OF_NEAREST),
        ({"minFilter": 9985}, Minify.LINEAR_OF_NEAREST),
        ({"minFilter": 9986}, Minify.NEAREST_BETWEEN),
        ({"minFilter": 9987}, Minify.LINEAR_BETWEEN),
    ],
)
def test_levels_are_read_as_the_sampler_says(maker: Maker, tmp_path: Path, min_filter: dict[str, int], minify: Minify) -> None:
    use = far_use(maker, tmp_path, **min_filter)
    assert use is not None and use.minify is minify


def test_a_filter_that_there_is_not_is_refused(maker: Maker, tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="unknown 9730"):
        far_use(maker, tmp_path, minFilter=9730)


def far_use(maker: Maker, folder: Path, **sampler: int) -> TextureUse | None:
    (folder / "wood.png").write_bytes(png((188, 188, 188, 255)))
    maker.add("images", uri="wood.png")
    maker.add("samplers", **sampler)
    maker.add("textures", source=0, sampler=0)
    maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")}))
    return read_scene(maker.write(folder)).materials[0].base_color_texture
