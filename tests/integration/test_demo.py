"""If this fails, the first thing that anybody tries, `make demo`, does not end with an image and its report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from integration.scenectl_process import scenectl
from loopback import addresses, ports_option

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""


@pytest.mark.timeout(300)
def test_the_demo_writes_image_and_report(tmp_path: Path) -> None:
    (tmp_path / "tmp").mkdir()
    to = tmp_path / "out" / "demo"
    small = ["--samples", "64", "--size", "96x72"]
    done = scenectl(
        "demo",
        "--output",
        to,
        *small,
        "--nodes",
        "3",
        "--ports",
        ports_option(*addresses(3)),
        limit_s=KERNELS_S,
        TMPDIR=str(tmp_path / "tmp"),
    )
    assert done.code == 0, done.err
    assert sorted(path.name for path in to.iterdir()) == ["image.exr", "image.png", "report.json"]
    report = json.loads((to / "report.json").read_text())
    assert (report["nodes"], report["paths"]) == (3, 64 * 96 * 72)
    said = done.out.decode()
    assert report["image_sha256"] in said and str(to / "report.json") in said
    with Image.open(to / "image.png") as image:
        assert image.size == (96, 72)
    (killed,) = report["nodes_killed"]
    assert report["nodes_lost"] in ([killed], []), "it may have been done before anybody noticed"
    assert f"node {killed} is killed on purpose" in done.err
    assert list((tmp_path / "tmp").iterdir()) == []
    alone = scenectl("demo", "--output", to, *small, "--nodes", "1", "--ports", ports_option(*addresses(1)), limit_s=KERNELS_S)
    assert alone.code == 0 and "killed" not in alone.err
    assert json.loads((to / "report.json").read_text())["image_sha256"] == report["image_sha256"]


def test_a_demo_that_cannot_write_starts_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert "file" in scenectl("demo", "--output", tmp_path / "file").refusal(1)
    assert "/proc/demo" in scenectl("demo", "--output", "/proc/demo").refusal(1)
    (tmp_path / "image.exr").mkdir()
    assert "is a folder" in scenectl("demo", "--output", tmp_path).refusal(1)
