"""If this fails, one bad number in a file makes pixels that are not finite, ends a render, or goes by without a word.

Each evil is written into a glTF beside a floor and a lamp that are good, read as any file is, and rendered to the end on one node and on three.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from render.rig import Rendered, Rig
from render.shapes import looking
from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
from unit.scene.gltf_maker import Maker, png

FLOOR = [[-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0], [-2.0, 0.0, -2.0]]
LAMP = [[-0.5, 2.0, -0.5], [0.5, 2.0, -0.5], [0.5, 2.0, 0.5], [-0.5, 2.0, 0.5]]
SQUARE = [[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 1.5, 0.0], [-0.5, 1.5, 0.0]]
CORNERS = np.array([0, 1, 2, 0, 2, 3], "<u2")
UVS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "<f4")
BRIGHTEST = 60.0
"""Nothing here shines brighter than the lamp, which has 20, but for a few fireflies."""

Evil = Callable[[Maker], dict[str, Any]]
"""Adds to a file what is wrong with it; returns the entries of the square's node."""


def square(maker: Maker, *, positions: Any = SQUARE, attributes: dict[str, Any] | None = None, **material: Any) -> int:
    number = maker.add("materials", **material)
    return maker.mesh(positions, CORNERS, material=number, attributes={"TEXCOORD_0": UVS, **(attributes or {})})


def textured(maker: Maker, content: bytes, slot: str = "baseColorTexture", **more: Any) -> int:
    maker.add("images", bufferView=maker.view(content), mimeType="image/png")
    texture = {"index": maker.add("textures", source=len(maker.json["images"]) - 1)}
    if slot == "baseColorTexture":
        return square(maker, pbrMetallicRoughness={slot: texture}, **more)
    return square(maker, **{slot: texture}, **more)


def black() -> bytes:
    return png((0, 0, 0, 255))


def deep(mode: str) -> bytes:
    """Sixteen bits of grey, or a palette with a transparent entry."""
    file = io.BytesIO()
    if mode == "palette":
        image = Image.new("P", (4, 4), 1)
        image.putpalette([0, 0, 0, 200, 100, 50])
        image.save(file, "PNG", transparency=1)
    else:
        Image.fromarray(np.linspace(0, 65535, 16).reshape(4, 4).astype(np.uint16)).save(file, "PNG")
    return file.getvalue()


def nan_normals(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, attributes={"NORMAL": np.full((4, 3), np.nan, "<f4")})}


def zero_normals(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, attributes={"NORMAL": np.zeros((4, 3), "<f4")})}


def reversed_normals(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, attributes={"NORMAL": np.tile([[0, 0, -1]], (4, 1)).astype("<f4")})}


def nan_uvs(maker: Maker) -> dict[str, Any]:
    number = textured(maker, png())
    maker.json["meshes"][number]["primitives"][0]["attributes"]["TEXCOORD_0"] = maker.accessor(np.full((4, 2), np.nan, "<f4"))
    return {"mesh": number}


def points_for_triangles(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, positions=[SQUARE[0]] * 4)}


def needles(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, positions=[SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[0]])}


def lamp_without_area(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, positions=[SQUARE[0], SQUARE[1], SQUARE[1], SQUARE[0]], emissiveFactor=[1, 1, 1])}


def lamp_of_hardly_any_area(maker: Maker) -> dict[str, Any]:
    low, high = SQUARE[0], [SQUARE[0][0] + 1e-30, SQUARE[0][1], SQUARE[0][2]]
    return {"mesh": square(maker, positions=[low, high, high, low], emissiveFactor=[1, 1, 1])}


def black_lamp(maker: Maker) -> dict[str, Any]:
    return {"mesh": textured(maker, black(), "emissiveTexture", emissiveFactor=[1, 1, 1])}


def negative_lamp(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, emissiveFactor=[-5, 0, 0])}


def endless_lamp(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, emissiveFactor=[1, 1, 1], extensions={"KHR_materials_emissive_strength": {"emissiveStrength": math.inf}})}


def flat_node(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "scale": [1, 0, 1]}


def node_of_nothing(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "scale": [0, 0, 0]}


def singular_matrix(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "matrix": [1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}


def mirrored(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "scale": [-1, 1, 1]}


def rough_below_zero(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker, pbrMetallicRoughness={"roughnessFactor": -3, "metallicFactor": 7, "baseColorFactor": [2, -1, 0.5, 3]})}


def index_below_one(maker: Maker) -> dict[str, Any]:
    extensions = {"KHR_materials_ior": {"ior": 0.2}, "KHR_materials_transmission": {"transmissionFactor": 9}}
    return {"mesh": square(maker, extensions=extensions)}


def coat_out_of_range(maker: Maker) -> dict[str, Any]:
    extensions = {"KHR_materials_clearcoat": {"clearcoatFactor": 4, "clearcoatRoughnessFactor": -1}}
    return {"mesh": square(maker, extensions=extensions)}


def sixteen_bits(maker: Maker) -> dict[str, Any]:
    return {"mesh": textured(maker, deep("grey"))}


def palette(maker: Maker) -> dict[str, Any]:
    return {"mesh": textured(maker, deep("palette"), alphaMode="MASK")}


def black_normal_map(maker: Maker) -> dict[str, Any]:
    return {"mesh": textured(maker, black(), "normalTexture")}


def coincident(maker: Maker) -> dict[str, Any]:
    maker.node(mesh=square(maker, pbrMetallicRoughness={"baseColorFactor": [1, 0, 0, 1]}))
    maker.node(mesh=square(maker, pbrMetallicRoughness={"metallicFactor": 0, "baseColorFactor": [0, 1, 0, 1]}))
    return {"mesh": square(maker, extensions={"KHR_materials_transmission": {"transmissionFactor": 1}})}


def far_away(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "translation": [1e12, 0, 0]}


def box_around_the_camera(maker: Maker) -> dict[str, Any]:
    return {"mesh": square(maker), "translation": [0, 0.3, 3.0], "scale": [1e-3, 1e-3, 1e-3]}


COUNTED: dict[Evil, str] = {
    **dict.fromkeys((negative_lamp, rough_below_zero, index_below_one, coat_out_of_range), "outside their range"),
    **dict.fromkeys((points_for_triangles, needles, lamp_without_area, lamp_of_hardly_any_area), "triangles without area (2)"),
    **dict.fromkeys((node_of_nothing, flat_node, singular_matrix), "triangles without area (2)"),
    **dict.fromkeys((nan_normals, zero_normals), "normals that were none"),
    nan_uvs: "texture coordinates that were not finite",
    sixteen_bits: "more than 8 bits",
}
"""What the importer mends or leaves out, and says so."""
EVILS: list[Evil] = [
    *(nan_normals, zero_normals, reversed_normals, nan_uvs, points_for_triangles, needles, lamp_without_area, lamp_of_hardly_any_area),
    *(black_lamp, negative_lamp, flat_node, node_of_nothing, singular_matrix, mirrored, rough_below_zero, index_below_one),
    *(coat_out_of_range, sixteen_bits, palette, black_normal_map, coincident, box_around_the_camera),
]


def written(folder: Path, evil: Evil) -> Path:
    maker = Maker()
    maker.node(mesh=maker.mesh(FLOOR, CORNERS, material=maker.add("materials", pbrMetallicRoughness={"metallicFactor": 0})))
    strength = {"KHR_materials_emissive_strength": {"emissiveStrength": 20}}
    maker.node(mesh=maker.mesh(LAMP, CORNERS, material=maker.add("materials", emissiveFactor=[1, 1, 1], extensions=strength)))
    maker.node(**evil(maker))
    return maker.write(folder)


def expect_numbers(image: Rendered) -> None:
    for name, layer in image.layers.items():
        # What a path does not meet is infinitely far.
        assert not np.isnan(layer).any() if name == "depth" else np.isfinite(layer).all(), name


@pytest.mark.parametrize("evil", EVILS, ids=lambda evil: evil.__name__)
def test_the_image_is_finite_and_the_same_on_any_nodes(tmp_path: Path, evil: Evil) -> None:
    scene = replace(read_scene(written(tmp_path, evil)), cameras=[looking((0, 0.8, 3.0), (0, 0.8, 0))])
    rig = Rig(scene, 12)
    one, three = (rig.render("voronoi", nodes, width=16, height=16, samples=16, sky=(0.5, 0.6, 0.7)) for nodes in (1, 3))
    expect_numbers(one)
    assert (one.beauty >= 0).all() and one.beauty.max() <= BRIGHTEST
    assert one.beauty[-1].mean() > 0.05, "the floor is still lit"
    assert (three.radiance == one.radiance).all()
    told = list(plan_import(scene).not_carried)
    assert (not told) if evil not in COUNTED else any(COUNTED[evil] in line for line in told), told


@pytest.mark.parametrize("place", [(0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.25, 2.0, 0.25)], ids=["in a square", "on the floor", "in the lamp"])
def test_a_camera_in_what_it_looks_at(tmp_path: Path, place: tuple[float, float, float]) -> None:
    scene = replace(read_scene(written(tmp_path, coincident)), cameras=[looking(place, (place[0], place[1], -5.0))])
    rig = Rig(scene, 12)
    one, three = (rig.render("bounded-radial", nodes, width=16, height=16, samples=16, sky=(0.5, 0.6, 0.7)) for nodes in (1, 3))
    expect_numbers(one)
    assert (three.radiance == one.radiance).all()


def loop(maker: Maker) -> dict[str, Any]:
    number = len(maker.json["nodes"])
    maker.node(root=False, children=[number + 1])
    return {"mesh": square(maker), "children": [number]}


@pytest.mark.parametrize(
    ("evil", "what"),
    [(endless_lamp, r"emissiveStrength is not finite"), (far_away, r"nodes\[2\] has a transform"), (loop, r"nodes\[\d\]")],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_what_means_nothing_is_refused_by_its_name(tmp_path: Path, evil: Evil, what: str) -> None:
    with pytest.raises(LocalFault, match=what):
        read_scene(written(tmp_path, evil))
