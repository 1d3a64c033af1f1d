"""If this fails, the main job is broken: a file, nodes, an image; or it leaves something behind when it is stopped."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest

from integration.scenectl_process import command, environment, free_ports, scenectl

NODES = ("127.0.0.2", "127.0.0.3")
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "room.obj"
    path.write_text(ROOM)
    return path


def _arguments(file: Path, to: Path, *more: str, samples: int = 2) -> list[str | Path]:
    arguments = ["render", "still", file, "--nodes", "2", "--ports", free_ports(*NODES), "--sky", "0.5,0.6,0.7"]
    return [*arguments, "--size", "48x32", "--samples", str(samples), "--threads", "1", "-o", to, *more]


def _leftovers(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.slow
def test_a_file_becomes_an_image(file: Path, tmp_path: Path) -> None:
    from PIL import Image

    temporary = tmp_path / "tmp"
    temporary.mkdir()
    hashes = []
    for algorithm in ("bounded-radial", "voronoi"):
        to = tmp_path / f"{algorithm}.exr"
        done = scenectl(*_arguments(file, to, "--algorithm", algorithm, "--json"), TMPDIR=str(temporary))
        assert done.code == 0, done.err
        report = done.json
        assert report["nodes"] == 2
        assert sum(report["records_per_node"].values()) == report["import"]["records"]
        assert set(report["seconds"]) >= {"read", "start", "import", "render", "write", "stop"}
        with Image.open(report["png"]) as image:
            assert image.size == (48, 32)
        assert to.stat().st_size > 0
        hashes.append(report["image_sha256"])
    assert hashes[0] == hashes[1]
    assert _leftovers(temporary) == [], "nodes and their folder are gone"


def test_a_bad_file_costs_no_cluster(tmp_path: Path) -> None:
    (tmp_path / "bad.glb").write_bytes(b"no scene at all")
    done = scenectl(*_arguments(tmp_path / "bad.glb", tmp_path / "o.exr", "--json"))
    assert done.code == 1
    assert "bad.glb" in done.error
    assert done.json["error"]["kind"] == "failed"
    assert _leftovers(tmp_path) == ["bad.glb"]


def test_an_output_that_cannot_be_written_is_noticed_first(file: Path, tmp_path: Path) -> None:
    done = scenectl(*_arguments(file, tmp_path / "missing" / "o.exr"))
    assert done.code == 1
    assert "missing" in done.error


def test_an_unknown_camera_is_named(file: Path, tmp_path: Path) -> None:
    done = scenectl(*_arguments(file, tmp_path / "o.exr", "--camera", "attic"))
    assert done.code != 0
    assert "attic" in done.error
    assert _leftovers(tmp_path) == ["room.obj"]


def test_ctrl_c_while_rendering_leaves_nothing(file: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    arguments = command(*_arguments(file, tmp_path / "o.exr", samples=1_000_000))
    with subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(None, TMPDIR=str(temporary)), text=True
    ) as process:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line.startswith("render:"):
                break
        process.send_signal(signal.SIGINT)
        _, rest = process.communicate(timeout=60)
    assert process.returncode == 130, [*lines, rest]
    assert "Traceback" not in rest
    assert _leftovers(temporary) == []
    assert _leftovers(tmp_path) == ["room.obj", "tmp"]
