"""If these failed, OBJ, PLY and STL files would come in wrong, or bad ones would crash an import."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.polygons import clip_ears
from scenefold.scene.payloads.materials import AlphaMode, TextureUse, Wrap
from unit.scene.gltf_maker import png

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
PLY = """ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z
element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"""


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def triangles(path: Path) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([part.positions[part.triangles] for part in read_scene(path).meshes[0]])


def area(found: np.ndarray) -> float:  # type: ignore[type-arg]
    """Signed, seen from +z."""
    return float(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2].sum() / 2)


def test_an_obj_without_materials_is_grey(tmp_path: Path) -> None:
    path = write(tmp_path, "a.obj", SQUARE + "f 1 2 3 4\n")
    scene = read_scene(path)
    assert scene.materials[0].base_color == (0.8, 0.8, 0.8, 1.0) and len(triangles(path)) == 2
    assert area(triangles(path)) == pytest.approx(1)


def test_materials_of_an_obj(tmp_path: Path) -> None:
    (tmp_path / "a wood.png").write_bytes(png())
    library = """newmtl old wood\nKd 0 0 0\nmap_Kd -s 2 2 1 -clamp on a wood.png\nNs 98
newmtl lamp\nKe 4 3 2\nKd 0.5 0.5 0.5\nnewmtl pane\nd 0.25\nillum 4\nNi 1.33\nnewmtl gauze\nTr 0.5\n"""
    write(tmp_path, "room.mtl", library)
    uses = "".join(f"usemtl {name}\nf 1/1 2/2 3/3\n" for name in ("old wood", "lamp", "pane", "gauze", "lost"))
    scene = read_scene(write(tmp_path, "a.obj", "mtllib room.mtl\n" + SQUARE + uses))
    by_name = {scene.materials[part.material].name: part for part in scene.meshes[0]}
    assert set(by_name) == {"old wood", "lamp", "pane", "gauze", "grey"}
    material = {material.name: material for material in scene.materials}
    assert material["old wood"].base_color_texture == TextureUse(0, 0, Wrap.CLAMP, Wrap.CLAMP) and material["old wood"].base_color[:3] == (
        1,
        1,
        1,
    )
    assert material["old wood"].roughness == pytest.approx(0.02**0.25)
    assert material["lamp"].emissive == (4, 3, 2)
    assert (material["pane"].transmission, material["pane"].ior) == (0.75, 1.33)
    assert material["gauze"].alpha_mode is AlphaMode.BLEND and material["gauze"].base_color[3] == 0.5
    assert by_name["lamp"].uvs is None and by_name["old wood"].uvs is not None
    # The picture's first row is its top; an OBJ's v runs upwards, and is scaled by 2 from the lower edge on.
    assert sorted(by_name["old wood"].uvs.tolist()) == [[0, 1], [2, -1], [2, 1]]
    assert any("grey instead (1)" in line for line in scene.not_carried)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be"])
def test_other_encodings_and_line_ends(tmp_path: Path, encoding: str) -> None:
    path = write(tmp_path, "a.obj", (SQUARE + "f 1 2 3").replace("\n", "\r\n").encode(encoding))
    assert len(triangles(path)) == 1


def test_faces_that_count_backwards_from_where_they_stand(tmp_path: Path) -> None:
    path = write(tmp_path, "a.obj", "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\n")
    assert np.array_equal(triangles(path)[0], [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_concave_polygons_keep_their_outline(tmp_path: Path) -> None:
    outline = [(0, 0), (4, 0), (4, 4), (3, 4), (3, 1), (1, 1), (1, 4), (0, 4)]
    vertices = "".join(f"v {x} {y} 0\n" for x, y in outline)
    path = write(tmp_path, "u.obj", vertices + "f " + " ".join(str(number + 1) for number in range(8)))
    found = triangles(path)
    crosses = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2]
    assert len(found) == 6 and area(found) == pytest.approx(10) and (crosses > 0).all()
    assert len(clip_ears([(float("nan"), 0.0, 0.0)] * 5)[0]) == 3


def test_hostile_text_takes_seconds_not_hours(tmp_path: Path) -> None:
    spaces = "usemtl a" + " " * 200_000 + "b\n" + "\n" * 200_000
    spiral = np.linspace(0, 60, 3_000)
    turns = "".join(f"v {r * np.cos(r)} {r * np.sin(r)} 0\n" for r in spiral) + "f " + " ".join(map(str, range(1, 3_001)))
    assert len(triangles(write(tmp_path, "a.obj", spaces + turns))) > 2_000


def test_ply_and_stl(tmp_path: Path) -> None:
    assert len(triangles(write(tmp_path, "a.ply", PLY))) == 1
    corners = struct.pack("<12fH", *[0.0] * 3, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    binary = write(tmp_path, "b.stl", bytes(80) + struct.pack("<I", 2) + corners * 2)
    assert len(triangles(binary)) == 2
    text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
    assert len(triangles(write(tmp_path, "t.stl", text))) == 1


def test_colours_of_vertices(tmp_path: Path) -> None:
    head = PLY.replace("property float z", "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue", 1)
    coloured = head.replace("0 0 0\n1 0 0\n0 1 0\n", "0 0 0 255 0 0\n1 0 0 0 188 0\n0 1 0 0 0 0\n")
    scene = read_scene(write(tmp_path, "c.ply", coloured))
    ((part,),) = scene.meshes
    assert part.colors is not None and scene.materials[0].base_color == (1.0, 1.0, 1.0, 1.0) and scene.not_carried == []
    # 188 is half as bright as 255.
    assert np.allclose(part.colors[:, :3], [[1, 0, 0], [0, 0.503, 0], [0, 0, 0]], atol=1e-3) and (part.colors[:, 3] == 1).all()
    assert any(item.payload[4] == 2 for item in plan_import(scene).items() if item.payload[:4] == b"sfga")


BAD = {
    "index.obj": (SQUARE + "f 1 2 9\n", "vertex 9, but there are 4"),
    "zero.obj": (SQUARE + "f 0 1 2\n", "vertex 0"),
    "backwards.obj": (SQUARE + "f -9 -2 -1\n", "not there"),
    "nan.obj": ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
    "words.obj": ("v a b c\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "cannot be read"),
    "points.obj": (SQUARE, "no triangle"),
    "texture.obj": ("mtllib t.mtl\n" + SQUARE + "usemtl t\nf 1/1 2/2 3/3\n", "missing"),
    "number.obj": ("mtllib n.mtl\n" + SQUARE + "usemtl n\nf 1 2 3\n", "no number"),
    "claim.ply": (PLY.replace("vertex 3", "vertex 4000000000"), "claims"),
    "index.ply": (PLY.replace("3 0 1 2", "3 0 1 7"), "7"),
    "nan.ply": (PLY.replace("1 0 0", "nan 0 0"), "finite"),
    "endless.ply": (PLY.replace("end_header", "comment"), "PLY header"),
    "cut.stl": (bytes(80) + struct.pack("<I", 2) + bytes(50), "STL"),
    "noise.stl": (b"solid " + bytes(range(256)) * 4, "cannot be read|no triangle"),
    "kind.off": ("OFF\n", "cannot be imported"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_gives_one_clear_error(tmp_path: Path, name: str) -> None:
    content, words = BAD[name]
    write(tmp_path, "t.mtl", "newmtl t\nmap_Kd lost.png\n")
    write(tmp_path, "n.mtl", "newmtl n\nKd a b c\n")
    with pytest.raises(LocalFault, match=words) as caught:
        plan_import(read_scene(write(tmp_path, name, content)))
    assert "\n" not in str(caught.value) and caught.value.remedy
