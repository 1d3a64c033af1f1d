"""If this fails, a scene file, camera or output that cannot be used costs a cluster, or ends in anything but one clear line."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import scenefold.node.local
from scenectl.program import main
from unit.scene.gltf_maker import TRIANGLE, Maker

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
WHOLE_LINE = re.compile(r"error: [^\n]+ \([^\n]+\): [^\n]+")


@pytest.fixture(autouse=True)
def no_cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def start(*_arguments: object, **_options: object) -> None:
        raise AssertionError("no node may be started")

    monkeypatch.setattr(scenefold.node.local, "local_cluster", start)
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    monkeypatch.chdir(tmp_path)


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str | Path, code: int = 1) -> str:
    """The one error line of a still that must not come about."""
    before = {path: path.stat().st_mtime_ns for path in Path().rglob("*")}
    assert main(["render", "still", *map(str, arguments)]) == code
    said = capsys.readouterr()
    lines = [line for line in said.err.splitlines() if not line.startswith("read: ")]
    assert said.out == ""
    assert len(lines) == 1 and WHOLE_LINE.fullmatch(lines[0]), said.err
    assert {path: path.stat().st_mtime_ns for path in Path().rglob("*")} == before, "something is half-written"
    return lines[0]


CONTENTS: dict[str, tuple[str, bytes, str]] = {
    "another kind of file": ("notes.txt", b"buy milk", "cannot be imported"),
    "text that is no scene": ("notes.glb", b"buy milk", "cannot be read"),
    "a GLB that is cut off": ("cut.glb", b"glTF\x02\0\0\0\xff\0\0\0", "cut.glb"),
    "JSON that is no glTF": ("other.gltf", b'{"milk": 1}', "asset.version"),
    "no PLY": ("notes.ply", b"buy milk", "no PLY"),
    "no STL": ("notes.stl", b"buy milk", "STL"),
    "an empty file": ("empty.obj", b"", "the file is empty"),
    "a scene without a triangle": ("points.obj", b"v 0 0 0\n", "the scene is empty"),
    "triangles without an area": ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "the scene is empty"),
    "a position that is no number": ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite corners"),
    "an index out of range": ("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a face names vertex 9, but there are 3"),
}


@pytest.mark.parametrize(("name", "content", "what"), CONTENTS.values(), ids=CONTENTS.keys())
def test_a_file_that_is_no_scene(name: str, content: bytes, what: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(name).write_bytes(content)
    line = refusal(capsys, name)
    assert what in line and name in line


def _nan(maker: Maker) -> None:
    positions = TRIANGLE.copy()
    positions[1, 2] = np.nan
    maker.node(mesh=maker.mesh(positions))


def _out_of_range(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(indices=np.array([0, 1, 3], "<u2")))


def _texture_missing(maker: Maker) -> None:
    maker.add("images", uri="wood.png")
    maker.add("textures", source=0)
    material = maker.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    maker.node(mesh=maker.mesh(attributes={"TEXCOORD_0": TRIANGLE[:, :2].copy()}, material=material))


def _buffer_missing(maker: Maker) -> None:
    maker.node(mesh=maker.mesh())
    maker.data = b""
    maker.json["buffers"] = [{"byteLength": 36, "uri": "gone.bin"}]


def _camera(maker: Maker, **node: object) -> None:
    maker.node(mesh=maker.mesh())
    maker.add("cameras", type="perspective", perspective={"yfov": 0.5, "znear": 0.1})
    maker.node(camera=0, name="main", **node)


def _node_cycle(maker: Maker) -> None:
    maker.node(mesh=maker.mesh(), children=[0])


@pytest.mark.parametrize(
    ("damage", "what"),
    [
        (_nan, "finite corners"),
        (_out_of_range, "index"),
        (_texture_missing, "wood.png"),
        (_buffer_missing, "gone.bin"),
        (_node_cycle, "nodes"),
    ],
)
def test_a_gltf_with_one_flaw(damage: Callable[[Maker], None], what: str, capsys: pytest.CaptureFixture[str]) -> None:
    maker = Maker()
    damage(maker)
    assert what in refusal(capsys, maker.write(Path()))


def test_an_unknown_camera_is_named_with_those_that_there_are(capsys: pytest.CaptureFixture[str]) -> None:
    maker = Maker()
    _camera(maker)
    line = refusal(capsys, maker.write(Path()), "--camera", "attic")
    assert "no camera 'attic'" in line and "'main'" in line


def test_what_is_no_file(capsys: pytest.CaptureFixture[str]) -> None:
    Path("folder.glb").mkdir()
    for name in ("nowhere.glb", "folder.glb", "with space/ü.glb"):
        assert name in refusal(capsys, name)


def test_outputs_that_cannot_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    Path("square.obj").write_text(SQUARE)
    Path("taken.exr").mkdir()
    assert "missing" in refusal(capsys, "square.obj", "-o", "missing/o.exr")
    assert "is a folder" in refusal(capsys, "square.obj", "-o", "taken.exr")
    # /proc takes no files, not even from root, which could write into any folder of ours.
    assert "cannot write there" in refusal(capsys, "square.obj", "-o", "/proc/o.exr")


def test_names_that_are_too_long_and_pipes_are_found_before_the_work(capsys: pytest.CaptureFixture[str]) -> None:
    Path("square.obj").write_text(SQUARE)
    os.mkfifo("pipe")
    assert "File name too long" in refusal(capsys, "square.obj", "-o", f"{'a' * 252}.exr")
    assert "File name too long" in refusal(capsys, "square.obj", "--report", "a" * 256)
    assert "File name too long" in refusal(capsys, "square.obj", "--resume", "a" * 250)
    assert "not a regular file" in refusal(capsys, "square.obj", "--resume", "pipe")


def test_a_scene_name_that_cannot_be(capsys: pytest.CaptureFixture[str]) -> None:
    Path("square.obj").write_text(SQUARE)
    for name in ("../attic", "a/b", "x" * 65, ".hidden"):
        assert "cannot be the name of a scene" in refusal(capsys, "square.obj", "--scene", name, code=2)


def test_an_unknown_profile(capsys: pytest.CaptureFixture[str]) -> None:
    Path("square.obj").write_text(SQUARE)
    assert "no cluster profile" in refusal(capsys, "square.obj", "--profile", "nowhere")
