"""If this fails, what ordinary programs write of cameras, lights and transforms keeps a whole file from being read, or is changed without a word."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
from scenefold.scene.importers.source import SourceScene
from unit.scene.gltf_maker import Maker


@pytest.fixture
def maker() -> Maker:
    made = Maker()
    made.node(mesh=made.mesh())
    return made


def read(maker: Maker, folder: Path) -> SourceScene:
    found = read_scene(maker.write(folder))
    assert plan_import(found).triangles == 1
    return found


def with_camera(maker: Maker, perspective: dict[str, Any], **node: Any) -> None:
    maker.add("cameras", type="perspective", perspective={"yfov": 0.5, "znear": 0.1} | perspective)
    maker.node(camera=0, **node)


def with_light(maker: Maker, **light: Any) -> None:
    maker.json["extensionsUsed"] = ["KHR_lights_punctual"]
    maker.json["extensions"] = {"KHR_lights_punctual": {"lights": [light]}}
    maker.node(extensions={"KHR_lights_punctual": {"light": 0}})


@pytest.mark.parametrize("scale", [[-1, 1, 1], [1, 1, -1], [2, -3, 1]])
def test_a_mirrored_camera_stands_and_looks_where_it_did(maker: Maker, tmp_path: Path, scale: list[float]) -> None:
    with_camera(maker, {}, scale=scale, translation=[1, 2, 3])
    found = read(maker, tmp_path)
    matrix = np.asarray(found.cameras[0].matrix)
    assert matrix[:3, 3].tolist() == [1, 2, 3]
    assert matrix[:3, 2].tolist() == [0, 0, math.copysign(1, scale[2])]
    assert matrix[:3, 1].tolist() == [0, math.copysign(1, scale[1]), 0]
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0), "right-handed"
    assert found.not_carried == ["mirrored cameras, shown unmirrored (1)"]


def test_a_camera_that_is_left_nowhere_to_look_is_none(maker: Maker, tmp_path: Path) -> None:
    with_camera(maker, {}, scale=[1, 0, 1])
    found = read(maker, tmp_path)
    assert (found.cameras, found.not_carried) == ([], ["cameras under a flat transform (1)"])


@pytest.mark.parametrize("planes", [{"zfar": 0.05}, {"znear": -1.0}, {"zfar": 0.1}])
def test_planes_that_cut_nothing_off_keep_nobody_from_reading(maker: Maker, tmp_path: Path, planes: dict[str, float]) -> None:
    with_camera(maker, planes)
    found = read(maker, tmp_path)
    assert (found.cameras[0].near, len(found.not_carried)) == (0.0, 1)


@pytest.mark.parametrize(("yfov", "expected"), [(3.2, math.pi), (0.0, 0.0), (-0.5, 0.0)])
def test_an_angle_of_view_beyond_its_range_is_moved_to_its_end(maker: Maker, tmp_path: Path, yfov: float, expected: float) -> None:
    with_camera(maker, {"yfov": yfov})
    found = read(maker, tmp_path)
    assert 0.0 < found.cameras[0].yfov < math.pi, "what the camera table can hold"
    assert found.cameras[0].yfov == pytest.approx(expected, abs=1e-5)
    assert found.not_carried == ["numbers of cameras and lights outside their range, moved to its end (1)"]


def test_planes_may_be_left_out(maker: Maker, tmp_path: Path) -> None:
    maker.add("cameras", type="perspective", perspective={"yfov": 0.5})
    maker.add("cameras", type="orthographic", orthographic={"xmag": 2.0, "ymag": 1.0})
    maker.node(camera=0)
    maker.node(camera=1)
    found = read(maker, tmp_path)
    assert ([camera.near for camera in found.cameras], found.not_carried) == ([0.0, 0.0], [])


def test_an_instance_without_a_rotation_is_not_turned(maker: Maker, tmp_path: Path) -> None:
    turns = np.array([[0, 0, 0, 0], [0, 0, 1, 0]], "<f4")
    instancing = {"attributes": {"ROTATION": maker.accessor(turns)}}
    maker.node(mesh=0, extensions={"EXT_mesh_gpu_instancing": instancing})
    found = read_scene(maker.write(tmp_path))
    assert np.array_equal(found.placed_matrices[1], np.eye(4))
    assert found.placed_matrices[2].diagonal() == pytest.approx([-1, -1, 1, 1])
    assert found.not_carried == ["rotations that are none, left out (1)"]


@pytest.mark.parametrize(
    ("cones", "expected", "notes"),
    [
        ({"innerConeAngle": 0.3, "outerConeAngle": 0.3}, (0.2999, 0.3), 0),
        ({"innerConeAngle": 0.0, "outerConeAngle": 1.57079637}, (0.0, math.pi / 2), 0),
        ({"innerConeAngle": 0.5, "outerConeAngle": 0.3}, (0.2999, 0.3), 1),
        ({"innerConeAngle": -1.0, "outerConeAngle": 3.0}, (0.0, math.pi / 2), 2),
        ({"innerConeAngle": 0.0, "outerConeAngle": 0.0}, (0.0, 2e-4), 0),
    ],
)
def test_spots_may_have_hard_edges(
    maker: Maker, tmp_path: Path, cones: dict[str, float], expected: tuple[float, float], notes: int
) -> None:
    with_light(maker, type="spot", spot=cones)
    found = read(maker, tmp_path)
    (light,) = found.punctual
    assert (light.inner_cone, light.outer_cone) == pytest.approx(expected)
    assert sum(int(note.rpartition("(")[2][:-1]) for note in found.not_carried) == notes


def test_negative_light_is_none(maker: Maker, tmp_path: Path) -> None:
    with_light(maker, type="point", intensity=-3.0, color=[1.0, -0.5, 2.0])
    found = read(maker, tmp_path)
    assert found.punctual[0].color == (0.0, 0.0, 0.0)
    assert found.not_carried == ["numbers of cameras and lights outside their range, moved to its end (2)"]


def test_transforms_that_are_right_but_for_rounding(maker: Maker, tmp_path: Path) -> None:
    matrix = np.eye(4)
    matrix[3] = 1e-9, 0.0, 0.0, 1.0000001
    maker.node(mesh=0, matrix=matrix.T.ravel().tolist())
    maker.node(mesh=0, rotation=[0.0, 0.0, 0.0, 0.0])
    found = read_scene(maker.write(tmp_path))
    assert [placed.tolist() for placed in found.placed_matrices] == [np.eye(4).tolist()] * 3
    assert found.not_carried == ["matrices that are affine but for rounding, made so (1)", "rotations that are none, left out (1)"]


def test_a_projection_is_no_transform(maker: Maker, tmp_path: Path) -> None:
    matrix = np.eye(4)
    matrix[3, 2] = -1.0
    maker.node(mesh=0, matrix=matrix.T.ravel().tolist())
    with pytest.raises(LocalFault, match="no affine transform"):
        read_scene(maker.write(tmp_path))


def test_scenes_that_are_not_shown_are_said(maker: Maker, tmp_path: Path) -> None:
    lost = maker.node(root=False, mesh=0)
    maker.json["scenes"] += [{"nodes": [lost]}, {"nodes": []}]
    found = read(maker, tmp_path)
    assert len(found.placed_meshes) == 1
    assert found.not_carried == ["scenes of the file that are not the one it shows (2)"]
