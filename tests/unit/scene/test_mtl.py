"""If these failed, surfaces of OBJ files would lose their maps, or wear them wrong."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import mtl_maps, plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.payloads.materials import AlphaMode, TextureUse
from scenefold.scene.payloads.texture_uses import IDENTITY
from unit.scene.gltf_maker import png

MESH = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def scene_of(folder: Path, lines: str, mesh: str = MESH) -> SourceScene:
    (folder / "m.mtl").write_text("newmtl m\n" + lines)
    (folder / "a.obj").write_text(mesh)
    return read_scene(folder / "a.obj")


def image(folder: Path, name: str, colour: tuple[int, int, int, int], size: tuple[int, int] = (4, 2)) -> None:
    (folder / name).write_bytes(png(colour, size))


def test_numbers_of_later_times(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "Pr 0.25\nPm 0.5\nPc 0.75\nPcr 0.125\nKe 1 2 3\n")
    surface = scene.materials[1]
    assert (surface.roughness, surface.metallic, surface.clearcoat, surface.clearcoat_roughness) == (0.25, 0.5, 0.75, 0.125)
    assert surface.emissive == (1.0, 2.0, 3.0) and scene.not_carried == []


def test_numbers_outside_their_range_are_moved_and_counted(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "Pr -1\nPm 7\nd 1.5\n")
    surface = scene.materials[1]
    assert (surface.roughness, surface.metallic, surface.base_color[3]) == (0.0, 1.0, 1.0)
    assert scene.not_carried == ["OBJ material numbers outside their range, moved to its end (3)"]


@pytest.mark.parametrize("line", ["Ni 0", "Ke -1 0 0", "Kd 3 0 0", "Ns -5", "Ni 1000", "Ke 0 0 1e13", "Kd 0 0 -1", "Ns 1e9"])
def test_every_number_that_is_moved_is_counted(tmp_path: Path, line: str) -> None:
    scene = scene_of(tmp_path, line + "\n")
    assert scene.not_carried == ["OBJ material numbers outside their range, moved to its end (1)"]
    list(plan_import(scene).items())


def test_a_colour_that_a_picture_replaces_is_moved_nowhere(tmp_path: Path) -> None:
    image(tmp_path, "a.png", (1, 2, 3, 255))
    assert scene_of(tmp_path, "Kd 3 3 3\nmap_Kd a.png\n").not_carried == []


def test_roughness_and_metallic_come_into_one_image(tmp_path: Path) -> None:
    image(tmp_path, "rough.png", (10, 10, 10, 255))
    image(tmp_path, "metal.png", (200, 200, 200, 255), (8, 4))
    scene = scene_of(tmp_path, "map_Pr rough.png\nmap_Pm metal.png\n")
    surface = scene.materials[1]
    assert surface.metallic_roughness_texture == TextureUse(0) and (surface.roughness, surface.metallic) == (1.0, 1.0)
    (texture,) = scene.textures
    assert (texture.width, texture.height, texture.srgb, texture.name) == (4, 2, False, "rough.png + metal.png")
    assert (texture.pixels() == [255, 10, 200, 255]).all()
    alone = scene_of(tmp_path, "map_Pr rough.png\nPm 0.5\nPr 0.5\n")
    assert (alone.materials[1].roughness, alone.materials[1].metallic) == (0.5, 0.5)
    assert (alone.textures[0].pixels() == [255, 10, 255, 255]).all()


@pytest.mark.parametrize("colour", [(90, 90, 90, 255), (255, 255, 255, 90)])
def test_holes_come_into_the_base_colours_alpha(tmp_path: Path, colour: tuple[int, int, int, int]) -> None:
    image(tmp_path, "leaf.png", (10, 200, 30, 255))
    image(tmp_path, "holes.png", colour, (2, 2))
    scene = scene_of(tmp_path, "map_Kd leaf.png\nmap_d holes.png\n")
    surface = scene.materials[1]
    assert surface.alpha_mode is AlphaMode.BLEND and surface.base_color == (1.0, 1.0, 1.0, 1.0)
    assert (scene.textures[0].pixels() == [10, 200, 30, 90]).all() and scene.textures[0].has_alpha
    bare = scene_of(tmp_path, "Kd 0.5 0.25 1\nmap_d holes.png\n")
    assert bare.materials[1].base_color == (0.5, 0.25, 1.0, 1.0)
    assert (bare.textures[0].pixels() == [255, 255, 255, 90]).all()
    list(plan_import(scene).items())


@pytest.mark.parametrize(("lines", "factor"), [("", (1.0, 1.0, 1.0)), ("Ke 0 0 0\n", (1.0, 1.0, 1.0)), ("Ke 2 4 8\n", (2.0, 4.0, 8.0))])
def test_lamps_with_pictures(tmp_path: Path, lines: str, factor: tuple[float, float, float]) -> None:
    image(tmp_path, "lamp.png", (255, 0, 0, 255))
    surface = scene_of(tmp_path, lines + "map_Ke lamp.png\n").materials[1]
    assert surface.emissive == factor and surface.mean_emissive == (factor[0], 0.0, 0.0) and surface.is_sampled_light


def test_normals_are_taken_and_heights_are_said(tmp_path: Path) -> None:
    image(tmp_path, "normals.png", (128, 128, 255, 255))
    image(tmp_path, "heights.png", (128, 128, 128, 255))
    scene = scene_of(tmp_path, "norm -bm 0.5 normals.png\nbump heights.png\n")
    surface = scene.materials[1]
    assert surface.normal_texture == TextureUse(0) and surface.normal_scale == 0.5
    assert not scene.textures[0].srgb and scene.not_carried == ["OBJ material maps bump (1)"]
    assert scene_of(tmp_path, "map_Bump normals.png\n").materials[1].normal_texture == TextureUse(0)
    assert scene_of(tmp_path, "map_Bump heights.png\n").materials[1].normal_texture is None


def test_scales_and_offsets_run_from_the_lower_edge(tmp_path: Path) -> None:
    image(tmp_path, "a.png", (1, 2, 3, 255))
    scene = scene_of(tmp_path, "map_Kd -s 2 4 -o 0.5 0.25 a.png\n")
    ((part,),) = scene.meshes
    assert part.uvs is not None and scene.materials[1].base_color_texture == TextureUse(0)
    # (u, v) of the file is read at (2 u + 0.5, 4 v + 0.25) from the lower edge.
    assert sorted(part.uvs.tolist()) == [[0.5, -3.25], [0.5, 0.75], [2.5, 0.75]]
    image(tmp_path, "n.png", (128, 128, 255, 255))
    scene = scene_of(tmp_path, "map_Kd -s 2 4 a.png\nnorm n.png\n")
    ((part,),) = scene.meshes
    uses = dict(scene.materials[1].uses())
    assert uses["base_color"].transform == (2.0, 0.0, 0.0, 0.0, 4.0, -3.0) and uses["normal"].transform == IDENTITY
    assert part.uvs is not None and sorted(part.uvs.tolist()) == [[0, 0], [0, 1], [1, 1]]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("Ks 1 0 0", "OBJ material statements ks (1)"),
        ("Ka 0.2 0.2 0.2", "OBJ material statements ka (1)"),
        ("Ka spectral light.rfl", "OBJ material statements ka (1)"),
        ("illum 3", "OBJ illumination models 3, shown as 2 (1)"),
        ("illum 0", "OBJ illumination models 0, shown as 2 (1)"),
        ("illum 7", "OBJ illumination models 7, shown as 2 (1)"),
        ("map_opacity a.png", "OBJ material maps map_opacity (1)"),
        ("sharpness 60", "OBJ material statements sharpness (1)"),
        ("refl -type sphere a.png", "OBJ material maps refl (1)"),
        ("Kd spectral light.rfl", "OBJ colours that are not in RGB (1)"),
        ("Ke xyz 1 1 1", "OBJ colours that are not in RGB (1)"),
        ("x" * 1000, f"OBJ material statements {'x' * 40} (1)"),
    ],
)
def test_every_statement_that_is_not_taken_over_is_said(tmp_path: Path, line: str, said: str) -> None:
    assert scene_of(tmp_path, line + "\n").not_carried == [said]


@pytest.mark.parametrize("lines", ["Ka 0 0.0 0.000", "illum 1", "illum 2", "illum 4\nd 0.5", "illum 9\nTr 0.5"])
def test_what_means_nothing_or_is_taken_over_is_not_said(tmp_path: Path, lines: str) -> None:
    assert scene_of(tmp_path, lines + "\n").not_carried == []


def test_a_file_that_many_materials_name_is_read_and_looked_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image(tmp_path, "heights.png", (128, 128, 128, 255))
    statements = "map_Kd heights.png\nbump ./heights.png\n"
    read, looked = [], []
    real, real_looks = Path.read_bytes, mtl_maps.looks_like_normals
    monkeypatch.setattr(Path, "read_bytes", lambda path: read.append(path.name) or real(path))
    monkeypatch.setattr(mtl_maps, "looks_like_normals", lambda pixels: looked.append(1) or real_looks(pixels))
    scene = scene_of(tmp_path, statements + "".join(f"newmtl m{number}\n{statements}" for number in range(20)))
    assert (read.count("heights.png"), len(looked), len(scene.textures)) == (1, 1, 1)
    assert scene.not_carried == ["OBJ material maps bump (21)"]


def test_what_is_left_behind_is_said(tmp_path: Path) -> None:
    image(tmp_path, "a.png", (1, 2, 3, 255))
    mesh = MESH.replace("1/1 2/2 3/3", "1 2 3")
    scene = scene_of(tmp_path, "map_Kd a.png\nmap_Ks a.png\ndisp a.png\nTf 1 0 0\naniso 1\n", mesh)
    assert scene.not_carried == [
        "OBJ material maps disp (1)",
        "OBJ material maps map_ks (1)",
        "OBJ material statements aniso (1)",
        "OBJ material statements tf (1)",
        "textures on meshes without texture coordinates (1)",
    ]


@pytest.mark.parametrize("line", ["norm lost.png", "map_Ke lost.png", "map_d lost.png", "map_Pr lost.png", "bump lost.png"])
def test_a_missing_map_is_an_error(tmp_path: Path, line: str) -> None:
    with pytest.raises(LocalFault, match="missing"):
        scene_of(tmp_path, line + "\n")


def test_a_deep_map_is_noted(tmp_path: Path) -> None:
    file = io.BytesIO()
    Image.fromarray(np.full((2, 2), 30_000, np.uint16)).save(file, "PNG")
    (tmp_path / "deep.png").write_bytes(file.getvalue())
    scene = scene_of(tmp_path, "map_Pr deep.png\n")
    assert scene.not_carried == ["images of more than 8 bits a channel, rounded to 8 (1)"]
    assert (scene.textures[0].pixels()[..., 1] == 117).all()
