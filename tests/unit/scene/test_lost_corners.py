"""If this fails, one position that is no number keeps a whole file from being read, or spoils what lies around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from unit.scene.gltf_maker import Maker

NOTE = "triangles with a corner that is not finite, left out (2)"
CORNERS = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [2.0, 0.0, 0.0]]
TRIANGLES = [[0, 1, 2], [2, 1, 3], [1, 4, 3]]


def text_of(kind: str, lost: str) -> str:
    """Three triangles, of which two have the corner 3, in a text format."""
    rows = [lost + " 1 0" if at == 3 else " ".join(map(str, row)) for at, row in enumerate(CORNERS)]
    if kind == "obj":
        return "".join(f"v {row}\n" for row in rows) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in TRIANGLES)
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    return head + "".join(row + "\n" for row in rows) + "".join(f"3 {a} {b} {c}\n" for a, b, c in TRIANGLES)


def expect_the_first(scene: SourceScene) -> None:
    ((part,),) = scene.meshes
    assert sorted(part.positions.tolist()) == sorted(CORNERS[:3]) and len(part.triangles) == 1
    assert scene.not_carried == [NOTE] and plan_import(scene).triangles == 1


@pytest.mark.parametrize("lost", ["nan", "inf"])
@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_texts(tmp_path: Path, kind: str, lost: str) -> None:
    path = tmp_path / f"a.{kind}"
    path.write_text(text_of(kind, lost))
    expect_the_first(read_scene(path))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("lost", [0x7F800001, 0x7FC00000, 0xFF800000])
def test_gltf(tmp_path: Path, lost: int) -> None:
    """A NaN that signals, a quiet one, and an infinite number."""
    corners = np.array(CORNERS, "<f4")
    corners.view("<u4")[3, 0] = lost
    maker = Maker()
    maker.node(
        mesh=maker.mesh(corners, np.array(TRIANGLES, "<u2").ravel(), attributes={"NORMAL": np.tile([[0, 0, 1]], (5, 1)).astype("<f4")})
    )
    expect_the_first(read_scene(maker.write(tmp_path)))


def test_a_corner_that_no_triangle_has_is_no_loss(tmp_path: Path) -> None:
    maker = Maker()
    maker.node(mesh=maker.mesh([*CORNERS[:3], [np.nan] * 3], np.array([0, 1, 2], "<u2")))
    assert read_scene(maker.write(tmp_path)).not_carried == []


def test_morph_targets_move_what_is_left(tmp_path: Path) -> None:
    maker = Maker()
    corners = [[np.nan] * 3, *CORNERS[:3]]
    target = maker.accessor(np.array([[0, 0, 1], [0, 0, 2], [0, 0, 3], [0, 0, 4]], "<f4"))
    mesh = maker.mesh(corners, np.array([0, 1, 2, 1, 2, 3], "<u2"), targets=[{"POSITION": target}])
    maker.node(mesh=mesh, weights=[1.0])
    ((part,),) = read_scene(maker.write(tmp_path)).meshes
    assert part.positions.tolist() == [[0, 0, 2], [1, 0, 3], [0, 1, 4]]
