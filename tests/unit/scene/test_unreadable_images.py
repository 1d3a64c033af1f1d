"""If this fails, one damaged image keeps a whole scene from being read, or leaves its surface black without a word."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.images import EncodedImage, UnreadableImage
from scenefold.scene.importers.source import SourceScene
from unit.scene.gltf_maker import Maker, png

DAMAGED = {"nothing": b"no image at all", "cut": png(size=(64, 64))[:60], "head": png()[:12]}
damages = pytest.mark.parametrize("content", DAMAGED.values(), ids=DAMAGED.keys())


def gltf_with(folder: Path, content: bytes, embedded: str, name: str = "") -> SourceScene:
    maker = Maker()
    entry: dict[str, Any] = {"name": name} if name else {}
    if embedded == "view":
        entry |= {"bufferView": maker.view(content), "mimeType": "image/png"}
    elif embedded == "data":
        entry |= {"uri": "data:image/png;base64," + base64.b64encode(content).decode()}
    else:
        (folder / "wood.png").write_bytes(content)
        entry |= {"uri": "wood.png"}
    maker.add("images", bufferView=maker.view(png()), mimeType="image/png")
    maker.add("images", **entry)
    maker.add("textures", source=0)
    maker.add("textures", source=1)
    maker.add(
        "materials",
        pbrMetallicRoughness={
            "baseColorTexture": {"index": 1},
            "baseColorFactor": [0.5, 0.25, 0.125, 1.0],
            "metallicRoughnessTexture": {"index": 0},
        },
        normalTexture={"index": 1},
        emissiveTexture={"index": 1},
        emissiveFactor=[0.5, 1.0, 0.0],
    )
    maker.node(mesh=maker.mesh(material=0, attributes={"TEXCOORD_0": np.zeros((3, 2), "<f4")}))
    return read_scene(maker.write(folder))


@damages
@pytest.mark.parametrize(
    ("embedded", "name", "said"), [("view", "", "image 1"), ("data", "", "image 1"), ("file", "", "wood.png"), ("view", "oak", "oak")]
)
def test_a_surface_has_its_factors_alone(tmp_path: Path, content: bytes, embedded: str, name: str, said: str) -> None:
    scene = gltf_with(tmp_path, content, embedded, name)
    wood = scene.materials[0]
    assert [slot for slot, _ in wood.uses()] == ["metallic_roughness"], "others keep theirs"
    assert wood.base_color == (0.5, 0.25, 0.125, 1.0) and wood.mean_emissive == (0.5, 1.0, 0.0)
    assert scene.not_carried == [f"the texture {said!r}, which cannot be read (1)"]
    assert plan_import(scene).triangles == 1


@damages
def test_materials_of_an_obj(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.png").write_bytes(content)
    (tmp_path / "good.png").write_bytes(png((200, 100, 50, 255)))
    maps = "map_Kd bad.png\nmap_Ke bad.png\nnorm bad.png\nmap_Pr bad.png\nmap_Pm good.png\nmap_d bad.png\n"
    (tmp_path / "m.mtl").write_text("newmtl m\nKd 0.5 0.25 0.125\nPr 0.75\n" + maps)
    (tmp_path / "a.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n")
    scene = read_scene(tmp_path / "a.obj")
    surface = scene.materials[1]
    assert [slot for slot, _ in surface.uses()] == ["metallic_roughness"]
    assert surface.base_color == (0.5, 0.25, 0.125, 1.0) and surface.roughness == 0.75
    assert not surface.shines, "a lamp whose picture is lost is none, unless Ke says so"
    assert scene.not_carried == ["the texture 'bad.png', which cannot be read (1)"]
    list(plan_import(scene).items())


@damages
def test_the_error_itself_names_no_object_of_the_program(content: bytes) -> None:
    with pytest.raises(UnreadableImage) as caught:
        EncodedImage(Path("a.gltf"), "the texture 'oak'", "oak", content).pixels()
    assert "the texture 'oak' cannot be read" in str(caught.value) and "object at 0x" not in str(caught.value)
