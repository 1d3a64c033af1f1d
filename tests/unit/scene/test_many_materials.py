"""If this fails, files that name a material for each of their things are refused, or wear the materials of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from unit.scene.gltf_maker import TRIANGLE, Maker, png

MERGED = "materials that differ from others in their name alone, merged"
RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture
def at_most_three(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside the one of those that name none."""
    for module in ("gltf_materials", "mtl", "obj"):
        monkeypatch.setattr(f"scenefold.scene.importers.{module}.MATERIALS_MAX", 4)


def coloured(maker: Maker, colour: tuple[float, float, float], **more: Any) -> int:
    return maker.add("materials", pbrMetallicRoughness={"baseColorFactor": [*colour, 1.0]}, **more)


def worn(maker: Maker, material: int | None, **attributes: Any) -> None:
    more = {} if material is None else {"material": material}
    maker.node(mesh=maker.mesh(TRIANGLE + len(maker.json["nodes"]), attributes=attributes, **more))


def colours(scene: SourceScene) -> list[tuple[float, ...]]:
    """Of the triangles, in the order of the nodes."""
    parts = [part for mesh in scene.placed_meshes for part in scene.meshes[mesh]]
    return [scene.materials[part.material].base_color[:3] for part in parts]


def test_a_million_materials_of_which_two_are_worn(tmp_path: Path) -> None:
    maker = Maker()
    coloured(maker, RED)
    maker.json["materials"] += [{}] * 999_998
    last = coloured(maker, BLUE)
    worn(maker, last)
    worn(maker, 0)
    scene = read_scene(maker.write(tmp_path))
    assert colours(scene) == [BLUE, RED] and len(scene.materials) == 3
    assert scene.not_carried == []


@pytest.mark.usefixtures("at_most_three")
def test_what_looks_alike_is_merged(tmp_path: Path) -> None:
    maker = Maker()
    for name in ("a", "b", "c"):
        for colour in (RED, GREEN, BLUE):
            worn(maker, coloured(maker, colour, name=name))
    worn(maker, None)
    worn(maker, 0)
    scene = read_scene(maker.write(tmp_path))
    assert colours(scene) == [RED, GREEN, BLUE] * 3 + [(0.8, 0.8, 0.8), RED]
    assert sorted(material.name for material in scene.materials) == ["a", "a", "a", "default"]
    assert scene.not_carried == [f"{MERGED} (6)"]
    assert plan_import(scene).triangles == 11


@pytest.mark.usefixtures("at_most_three")
def test_textures_and_their_coordinates_tell_materials_apart(tmp_path: Path) -> None:
    maker = Maker()
    maker.add("images", bufferView=maker.view(png()), mimeType="image/png")
    maker.add("textures", source=0)
    for number in (0, 1, 0, 1):
        scale = {"KHR_texture_transform": {"scale": [1.0 + number, 1.0]}}
        maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0, "extensions": scale}})
    for number in range(4):
        worn(maker, number, TEXCOORD_0=np.ones((3, 2), "<f4"))
    scene = read_scene(maker.write(tmp_path))
    parts = [scene.meshes[mesh][0] for mesh in scene.placed_meshes]
    assert [part.uvs[0, 0] for part in parts if part.uvs is not None] == [1.0, 2.0, 1.0, 2.0]
    assert len({part.material for part in parts}) == 2 and len(scene.textures) == 1


@pytest.mark.usefixtures("at_most_three")
def test_too_many_that_look_different_are_one_clear_error(tmp_path: Path) -> None:
    maker = Maker()
    for red in (0.1, 0.2, 0.3, 0.4):
        worn(maker, coloured(maker, (red, 0.0, 0.0)))
    with pytest.raises(LocalFault, match="materials has 4 entries, and more than 3 of those that are worn look different"):
        read_scene(maker.write(tmp_path))


def obj_with(folder: Path, uses: list[str], reds: dict[str, float]) -> SourceScene:
    """A triangle for each name that is used; "-" before one: it is named, and no face wears it."""
    (folder / "m.mtl").write_text("".join(f"newmtl {name}\nKd {red} 0 0\n" for name, red in reds.items()))
    lines = ["mtllib m.mtl"]
    for at, name in enumerate(uses):
        lines += [f"v {at} 0 0", f"v {at + 1} 0 0", f"v {at} 1 0", f"usemtl {name.strip('-')}"]
        lines += [] if name.startswith("-") else [f"f {3 * at + 1} {3 * at + 2} {3 * at + 3}"]
    (folder / "a.obj").write_text("\n".join(lines) + "\n")
    return read_scene(folder / "a.obj")


def reds_of(scene: SourceScene) -> list[float]:
    """Of the triangles, from left to right."""
    parts = scene.meshes[0]
    lefts = [(float(corners[:, 0].min()), part.material) for part in parts for corners in part.positions[part.triangles]]
    return [scene.materials[material].base_color[0] for _, material in sorted(lefts)]


@pytest.mark.usefixtures("at_most_three")
def test_names_of_an_obj(tmp_path: Path) -> None:
    reds = {"a": 0.1, "b": 0.2, "c": 0.1, "d": 0.3, "e": 0.2, "unused": 0.9, "never": 0.95}
    scene = obj_with(tmp_path, ["a", "-unused", "b", "c", "d", "e", "a"], reds)
    assert reds_of(scene) == [0.1, 0.2, 0.1, 0.3, 0.2, 0.1]
    assert [material.name for material in scene.materials[1:]] == ["a", "b", "d"]
    assert scene.not_carried == [f"{MERGED} (2)"]
    assert plan_import(scene).triangles == 6


@pytest.mark.usefixtures("at_most_three")
def test_names_of_an_obj_that_no_library_has(tmp_path: Path) -> None:
    scene = obj_with(tmp_path, ["lost", "gone", "a", "b"], {"a": 0.1, "b": 0.2})
    assert reds_of(scene) == [0.8, 0.8, 0.1, 0.2]
    assert scene.not_carried == [f"{MERGED} (1)", "materials that no library has, grey instead (2)"]


@pytest.mark.usefixtures("at_most_three")
def test_an_obj_whose_materials_look_different(tmp_path: Path) -> None:
    reds = {"a": 0.1, "b": 0.2, "c": 0.3, "d": 0.4}
    with pytest.raises(LocalFault, match="uses more than 3 materials that look different"):
        obj_with(tmp_path, list(reds), reds)
