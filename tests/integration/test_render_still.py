"""If this fails, the main job is broken: a file, nodes, an image, the same bits however many nodes there are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
import trio
from PIL import Image

from integration.scenectl_process import Done, running, scenectl
from loopback import addresses, free_ports, ports_option
from scenefold.client import Cluster, Scene, connect
from scenefold.node.local import local_cluster
from scenefold.render.client import StillOptions, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
SIZE = (48, 27)
OPTIONS = StillOptions(width=SIZE[0], height=SIZE[1], samples=4, seed=1)
REPORT = {
    *("scene", "file", "time", "nodes", "records_per_node", "import", "passes", "paths", "paths_per_second", "rays", "rays_per_second"),
    *("rays_passed", "rays_passed_per_path", "bytes_passed", "efficiency", "image_sha256", "exr", "png", "seconds", "left_out"),
}
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"

pytestmark = pytest.mark.timeout(360)


def still(*arguments: str | Path, profile: str | None = None, **env: str) -> Done:
    more = ["--size", f"{SIZE[0]}x{SIZE[1]}", "--samples", "4", "--json"]
    return scenectl("render", "still", *arguments, *more, profile=profile, limit_s=KERNELS_S, **env)


@pytest.fixture(scope="module")
def image_and_report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The sample on two nodes of its own, by the command that everybody uses; into a name that is not plain ASCII."""
    folder = tmp_path_factory.mktemp("a still")
    temporary = folder / "tmp"
    temporary.mkdir()
    to = folder / "Bild über all.exr"
    done = still(sample_scene_path(), "--nodes", "2", "--ports", ports_option(*addresses(2)), "-o", to, TMPDIR=str(temporary))
    assert done.code == 0, done.err
    assert list(temporary.iterdir()) == [], "nodes and their folder are gone"
    return to, done.json


def test_the_report_says_what_it_promises(image_and_report: tuple[Path, dict[str, Any]]) -> None:
    to, report = image_and_report
    assert set(report) >= REPORT
    assert report["nodes"] == 2 and set(report["records_per_node"]) == set(addresses(2))
    assert sum(report["records_per_node"].values()) == report["import"]["records"] > 0
    assert report["paths"] == SIZE[0] * SIZE[1] * 4
    assert report["rays"] > report["paths"] and report["paths_per_second"] > 0 and report["rays_per_second"] > 0
    assert report["pools"] == 2, "each holds all of so small a scene"
    assert report["rays_passed"] >= 0 and report["bytes_passed"] == 36 * report["rays_passed"]
    assert 0 < report["efficiency"] <= 1
    assert report["left_out"] == [], "these nodes are its own"
    assert set(report["seconds"]) >= {"read", "start", "import", "render", "write", "stop"}
    assert (report["exr"], report["png"]) == (str(to), str(to.with_suffix(".png")))


def test_the_image_has_the_layers_it_promises(image_and_report: tuple[Path, dict[str, Any]]) -> None:
    to, report = image_and_report
    with OpenEXR.File(str(to), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    assert set(channels) == {*"RGB", *(f"albedo.{c}" for c in "RGB"), *(f"normal.{c}" for c in "XYZ"), "depth.Z"}
    assert all(pixels.shape == SIZE[::-1] for pixels in channels.values())
    assert channels["G"].max() > 0 and channels["albedo.R"].max() > 0 and channels["depth.Z"].max() > 0
    with Image.open(report["png"]) as image:
        assert image.size == SIZE and len(set(image.convert("L").tobytes())) > 8


@pytest.mark.parametrize("count", [1, pytest.param(2, marks=pytest.mark.long), 5])
async def test_the_same_bits_on_any_nodes_divided_in_any_way(
    count: int, image_and_report: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    expected = image_and_report[1]["image_sha256"]
    with trio.fail_after(KERNELS_S):
        async with local_cluster(count, tmp_path, ports=free_ports(), trust=True) as nodes, connect(nodes.profile) as cluster:
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            picture = partial(_picture, cluster, scene)
            for algorithm in ("bounded-radial", "voronoi"):
                sha256, report = await picture(replace(OPTIONS, algorithm=algorithm))
                assert sha256 == expected, algorithm
                assert len(report["render_nodes"]) == count
                assert count == 1 or report["rays_passed_per_path"] > 0.3, algorithm
            if count == 2:
                other, _ = await picture(replace(OPTIONS, seed=2))
                assert other != expected


async def _picture(cluster: Cluster, scene: Scene, options: StillOptions) -> tuple[str, dict[str, Any]]:
    result = await render_still(cluster, scene, options, lambda *_: None)
    return image_sha256(result.layers["beauty"]), result.report


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Two nodes that hold the scene "room"."""
    folder = tmp_path_factory.mktemp("running")
    (folder / "room.obj").write_text(ROOM)
    with running("node", "local", "2", "--folder", folder, "--ports", ports_option(*addresses(2)), "--json") as (_, ready):
        imported = scenectl("scene", "import", folder / "room.obj", profile=ready["profile"])
        assert imported.code == 0, imported.err
        yield ready["profile"]


def test_a_scene_of_a_running_cluster(profile: str, tmp_path: Path) -> None:
    done = still("--scene", "room", "--sky", "0.5,0.6,0.7", "-o", tmp_path / "room.exr", profile=profile)
    assert done.code == 0, done.err
    assert done.json["nodes"] == 2 and done.json["file"] is None and done.json["import"] is None
    assert (tmp_path / "room.exr").stat().st_size > 0 and (tmp_path / "room.png").stat().st_size > 0


def test_a_part_of_the_image_with_every_layer_is_that_part_of_the_whole(profile: str, tmp_path: Path) -> None:
    lit = ["--scene", "room", "--sky", "0.5,0.6,0.7", "--layers", "all"]
    whole, part = tmp_path / "whole.exr", tmp_path / "part.exr"
    for to, more in ((whole, []), (part, ["--crop", "10,5,20,12"])):
        done = still(*lit, *more, "-o", to, profile=profile)
        assert done.code == 0, done.err
    assert done.json["crop"] == [10, 5, 20, 12]
    with OpenEXR.File(str(whole), separate_channels=True) as file, OpenEXR.File(str(part), separate_channels=True) as cut:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        cut_channels = {name: channel.pixels for name, channel in cut.channels().items()}
    assert channels.keys() == cut_channels.keys() > {"G", "depth.Z", *(f"indirect.{c}" for c in "RGB")}
    for name, pixels in cut_channels.items():
        assert np.array_equal(pixels, channels[name][5:17, 10:30]), name
    outside = scenectl("render", "still", *lit, "--size", "48x27", "--crop", "40,5,20,12", "-o", tmp_path / "o.exr", profile=profile)
    assert "crop" in outside.refusal(outside.code) and outside.code in (1, 2)


def test_what_the_scene_says_counts_for_whoever_says_nothing(profile: str, tmp_path: Path) -> None:
    said = scenectl("scene", "settings", "room", "--size", "24x12", "--samples", "2", "--sky", "0.5,0.6,0.7", "--json", profile=profile)
    assert said.code == 0, said.err
    assert (said.json["width"], said.json["height"], said.json["samples"], said.json["camera"]) == (24, 12, 2, None)
    shown = scenectl("scene", "settings", "room", profile=profile).out.decode()
    assert [line.split() for line in shown.splitlines()][1:3] == [["width", "24"], ["height", "12"]]
    done = scenectl("render", "still", "--scene", "room", "-o", tmp_path / "said.exr", "--json", profile=profile, limit_s=KERNELS_S)
    assert done.code == 0, done.err
    assert done.json["paths"] == 24 * 12 * 2
    own = scenectl("render", "still", "--scene", "room", "--samples", "1", "-o", tmp_path / "own.exr", "--json", profile=profile)
    assert own.json["paths"] == 24 * 12
    assert "an image is by default: width 24" in scenectl("scene", "log", "room", "--last", "1", profile=profile).out.decode()
    unknown = scenectl("scene", "settings", "room", "--camera", "nope", profile=profile)
    assert "the scene has no camera 'nope'" in unknown.refusal(1)
    assert "--samples" in scenectl("scene", "settings", "room", "--samples", "0", profile=profile).refusal(2)
    assert scenectl("scene", "settings", "room", "--clear", "--json", profile=profile).json["width"] is None


@pytest.mark.parametrize(
    ("arguments", "code", "what"),
    [
        (["--scene", "attic"], 1, "attic"),
        (["--scene", "room", "--camera", "attic"], 1, "no camera 'attic'"),
        (["--scene", "room", "--size", "16384x16384"], 1, "may use"),
        (["--scene", "empty"], 1, "the scene is empty"),
    ],
)
def test_what_a_running_cluster_cannot_render(arguments: list[str], code: int, what: str, profile: str, tmp_path: Path) -> None:
    if "empty" in arguments:
        assert scenectl("scene", "create", "empty", profile=profile).code == 0
    done = scenectl("render", "still", *arguments, "-o", tmp_path / "o.exr", profile=profile)
    assert ("prepare: 0 of 1 scene" in done.err) == ("attic" not in arguments[:2]), "whoever waits hears at once that it has begun"
    assert what in done.refusal(code)
    assert list(tmp_path.iterdir()) == []
    assert scenectl("cluster", "status", profile=profile).code == 0, "the nodes live on"


def test_a_render_that_nobody_waits_for(profile: str, tmp_path: Path) -> None:
    def render(verb: str, *arguments: str | Path) -> Done:
        return scenectl("render", verb, *arguments, profile=profile, limit_s=KERNELS_S)

    lit = ["--scene", "room", "--sky", "0.5,0.6,0.7", "--json"]
    small = [*lit, "--size", "48x27", "--samples", "4"]
    waited = render("still", *small, "-o", tmp_path / "waited.exr").json
    begun = render("start", *small)
    assert begun.code == 0 and begun.json["nodes"] == 2, begun.err
    name = begun.json["render"]
    watched = render("watch", name[:6], "--json")
    assert (watched.json["render"], watched.json["phase"], watched.json["scene"]) == (name, "done", "room")
    assert [one["render"] for one in render("list", "--json").json["renders"]] == [name]
    for more in (["--keep"], ["--wait"]):
        fetched = render("fetch", name, "-o", tmp_path / "fetched.exr", "--json", *more)
        assert fetched.json["image_sha256"] == waited["image_sha256"] and fetched.json["exposure"] == waited["exposure"]
    assert "no such render" in render("fetch", name, "-o", tmp_path / "again.exr").refusal(1)

    long = render("start", *lit, "--size", "1024x768", "--samples", "65536").json["render"]
    assert "not there yet" in render("fetch", long, "-o", tmp_path / "long.exr").refusal(3)
    listed = render("list").out.decode()
    assert long in listed and "rendering, " in listed and name not in listed
    assert render("cancel", long, "--json").json["phase"] == "cancelled"
    assert "no such render" in render("cancel", long).refusal(1)
    assert "no renders of yours" in render("list").out.decode()
    assert "no camera" in render("start", *small, "--camera", "nobody").refusal(1)
