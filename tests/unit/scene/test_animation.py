"""If these failed, a frame of a film would show its scene at another moment, or what moves bent out of shape."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.scene.importers import AT_REST, Moment, SourceScene, moment_of_frame, plan_import, read_scene
from unit.scene.gltf_maker import TRIANGLE, Maker

HALF = 0.5**0.5
QUARTER_TURN = [0, 0, HALF, HALF]
"""About z."""


def f4(*values: Any) -> Any:
    return np.array(values, "<f4")


class Film(Maker):
    """A glTF that moves."""

    def moves(self, node: int, path: str, times: Any, values: Any, name: str = "act", **sampler: Any) -> None:
        entry = {"input": self.accessor(f4(*times)), "output": self.accessor(np.asarray(values, "<f4")), **sampler}
        channel = {"sampler": 0, "target": {"node": node, "path": path}}
        self.add("animations", name=name, samplers=[entry], channels=[channel])

    def bent(self, joints: list[int], matrices: Any = None, **more: Any) -> int:
        inverse = {} if matrices is None else {"inverseBindMatrices": self.accessor(f4(*matrices).transpose(0, 2, 1).reshape(-1, 16))}
        return self.add("skins", joints=joints, **inverse, **more)


@pytest.fixture
def film() -> Film:
    return Film()


def skin_mesh(film: Film, joints: Any, weights: Any, **more: Any) -> int:
    held = {"JOINTS_0": np.array(joints, "u1"), "WEIGHTS_0": f4(*weights)}
    return film.mesh(attributes=held | more)


def corners(scene: SourceScene) -> Any:
    """f64[nt, 3, 3] of all triangles in the world."""
    found = []
    for mesh, matrix in zip(scene.placed_meshes, scene.placed_matrices, strict=True):
        for part in scene.meshes[mesh]:
            found.append((part.positions @ matrix[:3, :3].T + matrix[:3, 3])[part.triangles])  # noqa: PERF401
    return np.concatenate(found)


def test_nodes_stand_where_their_animations_say(film: Film, tmp_path: Path) -> None:
    child = film.node(root=False, mesh=film.mesh(), translation=[9, 9, 9])
    parent = film.node(children=[child])
    film.moves(child, "translation", [0, 2], [[0, 0, 0], [4, 0, 0]])
    film.moves(parent, "rotation", [0, 1], [[0, 0, 0, 1], QUARTER_TURN])
    film.moves(parent, "scale", [0, 1], [[1, 1, 1], [3, 3, 3]], interpolation="STEP")
    path = film.write(tmp_path)
    assert corners(read_scene(path))[0] == pytest.approx(TRIANGLE + f4(9, 9, 9))
    scene = read_scene(path, Moment(1.0))
    assert scene.name == "test.gltf at 1 s" and scene.not_carried == []
    assert corners(scene)[0] == pytest.approx(np.array([[0, 6, 0], [0, 9, 0], [-3, 6, 0]]), abs=1e-6)
    assert corners(read_scene(path, moment_of_frame(12, 24)))[0, 0] == pytest.approx([HALF, HALF, 0], abs=1e-6)


def test_at_rest_animations_are_counted_and_not_even_read(film: Film, tmp_path: Path) -> None:
    node = film.node(mesh=film.mesh())
    film.moves(node, "translation", [1, 0], [[0, 0, 0], [4, 0, 0]])
    assert read_scene(film.write(tmp_path)).not_carried == ["animations, shown at rest (1)"]


def test_one_animation_may_be_named_and_else_the_first_of_two_counts(film: Film, tmp_path: Path) -> None:
    node = film.node(mesh=film.mesh())
    film.moves(node, "translation", [0], [[1, 0, 0]], name="walk")
    film.moves(node, "translation", [0], [[2, 0, 0]], name="run")
    path = film.write(tmp_path)
    both = read_scene(path, Moment(0.0))
    assert corners(both)[0, 0, 0] == 1 and both.not_carried == ["animation channels of what an earlier one moves (1)"]
    assert corners(read_scene(path, Moment(0.0, "run")))[0, 0, 0] == 2
    with pytest.raises(LocalFault, match=r"no animation 'fly'.*'walk', 'run'"):
        read_scene(path, Moment(0.0, "fly"))


def test_cameras_and_lights_move_too(film: Film, tmp_path: Path) -> None:
    film.node(mesh=film.mesh())
    film.add("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.1})
    film.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    node = film.node(camera=0, extensions={"KHR_lights_punctual": {"light": 0}})
    film.moves(node, "translation", [0, 1], [[0, 0, 0], [0, 0, 8]])
    scene = read_scene(film.write(tmp_path), Moment(0.5))
    assert scene.cameras[0].matrix[2, 3] == 4 and scene.punctual[0].position == (0, 0, 4)


def test_a_file_without_animation_has_no_moments(film: Film, tmp_path: Path) -> None:
    film.node(mesh=film.mesh())
    with pytest.raises(LocalFault, match="no animation"):
        read_scene(film.write(tmp_path), Moment(0.0))
    (tmp_path / "still.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(LocalFault, match="hold no animation"):
        read_scene(tmp_path / "still.obj", Moment(0.0))


@pytest.mark.parametrize("time", [-1.0, float("nan"), float("inf"), 1e7])
def test_moments_are_within_bounds(time: float) -> None:
    with pytest.raises(UsageFault):
        Moment(time)


def test_a_name_needs_a_time_and_frames_a_pace() -> None:
    with pytest.raises(UsageFault, match="no time"):
        Moment(None, "walk")
    for fps in (0.0, -1.0, float("nan")):
        with pytest.raises(UsageFault, match="fps"):
            moment_of_frame(1, fps)
    assert moment_of_frame(12, 25.0) == Moment(0.48) and Moment() == AT_REST


@pytest.mark.parametrize(
    ("path", "times", "values", "sampler", "said"),
    [
        ("translation", [1, 0], [[0, 0, 0]] * 2, {}, "fall"),
        ("translation", [0, float("nan")], [[0, 0, 0]] * 2, {}, "not finite"),
        ("translation", [0, 1], [[0, 0, 0], [0, float("inf"), 0]], {}, "not finite"),
        ("translation", [0, 1], [[0, 0, 0]] * 3, {}, "3 values for 2"),
        ("translation", [0, 1], [[0, 0, 0]] * 2, {"interpolation": "CUBICSPLINE"}, "2 values for 2"),
        ("translation", [0, 1], [[0, 0, 0]] * 2, {"interpolation": "WILD"}, "unknown"),
        ("translation", [0, 1], [[0, 0, 0, 0]] * 2, {}, "VEC3 is needed"),
        ("translation", [0, 1], [[0, 0, 0]] * 2, {"input": 99}, "names accessor 99"),
        ("rotation", [0, 1], [[0, 0, 0, 1], [0, 0, 0, 0]], {}, "rotation that is none"),
        ("translation", [0], [[1e30, 0, 0]], {}, "beyond measure"),
    ],
)
def test_tracks_that_are_none_are_refused(film: Film, tmp_path: Path, path: str, times: Any, values: Any, sampler: Any, said: str) -> None:
    film.moves(film.node(mesh=film.mesh()), path, times, values, **sampler)
    with pytest.raises(LocalFault, match=said):
        read_scene(film.write(tmp_path), Moment(0.5))


def test_a_matrix_cannot_be_animated(film: Film, tmp_path: Path) -> None:
    node = film.node(mesh=film.mesh(), matrix=np.eye(4).ravel().tolist())
    film.moves(node, "translation", [0], [[1, 0, 0]])
    with pytest.raises(LocalFault, match="no animation can move"):
        read_scene(film.write(tmp_path), Moment(0.0))


def test_channels_of_what_is_not_known_are_counted(film: Film, tmp_path: Path) -> None:
    film.node(mesh=film.mesh())
    film.moves(0, "pointer", [0], [[1, 0, 0]])
    film.moves(0, "scale", [0], [[1, 0, 0]])
    del film.json["animations"][1]["channels"][0]["target"]["node"]
    assert read_scene(film.write(tmp_path), Moment(0.0)).not_carried == [
        "animation channels of pointer (1)", "animation channels of scale without a node (1)",
    ]  # fmt: skip


def test_joints_carry_vertices_by_their_weights_and_the_meshs_own_node_does_not(film: Film, tmp_path: Path) -> None:
    joints = [film.node(), film.node(translation=[0, 5, 0])]
    skin = film.bent(joints, [np.eye(4), np.eye(4)])
    mesh = skin_mesh(film, [[0, 1, 0, 0]] * 3, [[1, 0, 0, 0], [1, 1, 0, 0], [0, 3, 0, 0]])
    film.node(mesh=mesh, skin=skin, translation=[100, 0, 0])
    film.moves(joints[1], "translation", [0, 1], [[0, 5, 0], [0, 0, 8]])
    path = film.write(tmp_path)
    assert corners(read_scene(path))[0] == pytest.approx(np.array([[0, 0, 0], [1, 2.5, 0], [0, 6, 0]]))
    assert corners(read_scene(path, Moment(1.0)))[0] == pytest.approx(np.array([[0, 0, 0], [1, 0, 4], [0, 1, 8]]))


def test_inverse_bind_matrices_come_first(film: Film, tmp_path: Path) -> None:
    joint = film.node(rotation=QUARTER_TURN)
    inverse = np.eye(4)
    inverse[0, 3] = -1.0
    mesh = skin_mesh(film, [[0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3, NORMAL=f4([1, 0, 0], [1, 0, 0], [0, 1, 0]))
    film.node(mesh=mesh, skin=film.bent([joint], [inverse]))
    scene = read_scene(film.write(tmp_path))
    assert corners(scene)[0] == pytest.approx(np.array([[0, -1, 0], [0, 0, 0], [-1, -1, 0]]), abs=1e-6)
    assert scene.meshes[0][0].normals == pytest.approx(np.array([[0, 1, 0], [0, 1, 0], [-1, 0, 0]]), abs=1e-6)


def test_a_mirroring_joint_keeps_outside_outside(film: Film, tmp_path: Path) -> None:
    joint = film.node(scale=[-2, 1, 1])
    mesh = skin_mesh(film, [[0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3, NORMAL=f4([0, 0, 1], [1, 0, 1], [0, 0, 1]))
    film.node(mesh=mesh, skin=film.bent([joint]))
    (part,) = read_scene(film.write(tmp_path)).meshes[0]
    first, second, third = part.positions[part.triangles[0]]
    assert np.cross(second - first, third - first)[2] > 0
    assert part.normals is not None and part.normals[1] == pytest.approx([-0.5, 0, 1])


def test_two_nodes_with_one_mesh_are_bent_apart(film: Film, tmp_path: Path) -> None:
    skins = [film.bent([film.node(translation=[x, 0, 0])]) for x in (1, 2)]
    mesh = skin_mesh(film, [[0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3)
    for skin in skins:
        film.node(mesh=mesh, skin=skin)
    film.node(mesh=mesh, translation=[7, 0, 0])
    assert sorted(corners(read_scene(film.write(tmp_path)))[:, 0, 0].tolist()) == [1, 2, 7]


def test_vertices_that_nothing_holds_follow_their_node_and_are_counted(film: Film, tmp_path: Path) -> None:
    skin = film.bent([film.node()])
    weights = [[float("nan"), -1, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]]
    film.node(mesh=skin_mesh(film, [[0, 9, 9, 9]] * 3, weights), skin=skin, translation=[0, 0, 4])
    film.node(mesh=film.mesh(), skin=skin, translation=[0, 0, 6])
    scene = read_scene(film.write(tmp_path))
    assert corners(scene)[:, :, 2].tolist() == [[4, 4, 0], [6, 6, 6]]
    assert scene.not_carried == [
        "joint weights that were none, taken for 0 (2)", "skinned primitives without joints, which follow their node (1)",
        "vertices that no joint holds, which follow their node (2)",
    ]  # fmt: skip


def test_a_skin_whose_joints_are_not_shown_leaves_the_mesh_as_it_is(film: Film, tmp_path: Path) -> None:
    skin = film.bent([film.node(root=False, translation=[0, 0, 9])])
    film.node(mesh=skin_mesh(film, [[0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3), skin=skin)
    scene = read_scene(film.write(tmp_path))
    assert corners(scene)[0] == pytest.approx(TRIANGLE) and "does not show" in scene.not_carried[0]


@pytest.mark.parametrize("what", ["joint", "no joints", "few matrices", "matrix", "count", "kind", "flat"])
def test_skins_that_are_none_are_refused(film: Film, tmp_path: Path, what: str) -> None:
    joints = [film.node(scale=[1, 1, 0] if what == "flat" else [1, 1, 1]) for _ in range(2)]
    matrices = [np.eye(4) * (np.nan if what == "matrix" else 1)] * (1 if what == "few matrices" else 2)
    held = [[3 if what == "joint" else 1, 0, 0, 0]] * (2 if what == "count" else 3)
    mesh = skin_mesh(film, held, [[1, 0, 0, 0]] * 3)
    if what == "kind":
        attributes = film.json["meshes"][mesh]["primitives"][0]["attributes"]
        attributes["JOINTS_0"] = attributes["WEIGHTS_0"]
    film.node(mesh=mesh, skin=film.bent([] if what == "no joints" else joints, matrices))
    path = film.write(tmp_path)
    if what == "flat":  # A flat joint is no fault: it leaves a flat mesh.
        assert plan_import(read_scene(path)).triangles == 1
        return
    with pytest.raises(LocalFault):
        read_scene(path)


def morph_mesh(film: Film, **more: Any) -> int:
    mesh = film.mesh(attributes={"NORMAL": f4(*[[0, 0, 1]] * 3)}, **more)
    targets = [
        {"POSITION": film.accessor(f4(*[[0, 0, 2]] * 3)), "NORMAL": film.accessor(f4(*[[1, 0, 0]] * 3))},
        {"POSITION": film.accessor(f4(*[[0, 4, 0]] * 3))},
    ]
    film.json["meshes"][mesh]["primitives"][0]["targets"] = targets
    return mesh


def test_morph_targets_are_added_at_the_weights_of_mesh_node_or_animation(film: Film, tmp_path: Path) -> None:
    mesh = morph_mesh(film)
    film.node(mesh=mesh)
    film.node(mesh=mesh, weights=[1, 0])
    moved = film.node(mesh=mesh, weights=[1, 0])
    film.json["meshes"][mesh]["weights"] = [0, 0.5]
    film.moves(moved, "weights", [0, 1], [0, 0, 1, 1])
    path = film.write(tmp_path)
    assert corners(read_scene(path))[:, 0].tolist() == [[0, 2, 0], [0, 0, 2], [0, 0, 2]]
    scene = read_scene(path, Moment(0.5))
    assert corners(scene)[:, 0].tolist() == [[0, 2, 0], [0, 0, 2], [0, 2, 1]]
    normals = scene.meshes[scene.placed_meshes[2]][0].normals
    assert normals is not None and normals[0].tolist() == [0.5, 0, 1]


def test_nodes_that_morph_alike_share_their_triangles(film: Film, tmp_path: Path) -> None:
    mesh = morph_mesh(film)
    for x in range(3):
        film.node(mesh=mesh, weights=[0, 0 if x == 0 else 1], translation=[x, 0, 0])
    assert read_scene(film.write(tmp_path)).placed_meshes.tolist() == [0, 1, 1]


@pytest.mark.parametrize("what", ["weights", "count", "infinite"])
def test_morphs_that_are_none_are_refused(film: Film, tmp_path: Path, what: str) -> None:
    mesh = morph_mesh(film)
    deltas = f4(*[[0, 0, 3e38 if what == "infinite" else 1]] * (2 if what == "count" else 3))
    film.json["meshes"][mesh]["primitives"][0]["targets"][0]["POSITION"] = film.accessor(deltas)
    film.node(mesh=mesh, weights=[1, 1, 1] if what == "weights" else [9, 1])
    with pytest.raises(LocalFault):
        read_scene(film.write(tmp_path))


@pytest.mark.filterwarnings("error")
def test_what_is_no_number_at_all_is_found_without_a_warning(film: Film, tmp_path: Path) -> None:
    """A NaN that signals speaks up when it is made wider."""
    signalling = np.full((3, 4), 0x7F800001, "<u4").view("<f4")
    joint = film.node()
    film.node(mesh=skin_mesh(film, [[0, 0, 0, 0]] * 3, signalling), skin=film.bent([joint]))
    film.moves(joint, "translation", [0], signalling[:1, :3])
    path = film.write(tmp_path)
    assert "joint weights that were none, taken for 0 (12)" in read_scene(path).not_carried
    with pytest.raises(LocalFault, match="not finite"):
        read_scene(path, Moment(0.0))


def test_files_that_share_their_data_thousands_of_times_are_refused(film: Film, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.scene.importers.gltf_skins._JOINTS_MAX", 3)
    monkeypatch.setattr("scenefold.scene.importers.gltf_animations._VALUES_MAX", 20)
    monkeypatch.setattr("scenefold.scene.importers.gltf_meshes._SHAPED_TRIANGLES_MAX", 2)
    monkeypatch.setattr("scenefold.scene.importers.gltf_shapes._MORPHED_MAX", 11)
    joints = [film.node(), film.node()]
    film.moves(joints[0], "translation", [0, 1], [[0, 0, 0]] * 2)
    mesh, skins = skin_mesh(film, [[0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3), [film.bent(joints), film.bent(joints)]
    film.node(mesh=mesh, skin=skins[0])
    path = film.write(tmp_path)
    read_scene(path, Moment(0.0))
    film.moves(joints[1], "translation", [0, 1], [[0, 0, 0]] * 2)
    with pytest.raises(LocalFault, match="numbers in keyframes"):
        read_scene(film.write(tmp_path), Moment(0.0))
    for _ in range(2):
        film.node(mesh=mesh, skin=skins[0])
    with pytest.raises(LocalFault, match="poses of their own"):
        read_scene(film.write(tmp_path))
    film.node(mesh=mesh, skin=skins[1])
    with pytest.raises(LocalFault, match="joints"):
        read_scene(film.write(tmp_path))
    morphs = Film()
    morph = morph_mesh(morphs)
    for weights in ([1, 1], [1, 2]):
        morphs.node(mesh=morph, weights=weights)
    with pytest.raises(LocalFault, match="morphed vertices"):
        read_scene(morphs.write(tmp_path))
