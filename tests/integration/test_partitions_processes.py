"""If this fails, `render still --partition` and `render report` do not do what they say, alone or with a Dask cluster."""

from __future__ import annotations

import importlib.util
import io
import json
import os
import signal
import socket
import sys
import time
import types
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import trio

from integration.dask_cluster import NEEDS, always_dies, dask_cluster, dies_once, nothing
from integration.scenectl_process import Done, running, scenectl
from loopback import addresses, ports_option
from scenectl import still_frames
from scenectl.program import main
from scenefold.base.errors import LocalFault, Unreachable
from scenefold.client import Scene
from scenefold.client.ending import SceneEnd
from scenefold.scene.sample import sample_scene_path
from scenefold.world import offline_world

SIZE = ("--size", "48x27", "--samples", "4")
SKY = ("--sky", "0.5,0.6,0.7")
HAS_DASK = all(importlib.util.find_spec(name) for name in ("dask", "distributed"))

pytestmark = pytest.mark.timeout(360)
needs_dask = pytest.mark.skipif(not HAS_DASK, reason=NEEDS)


def still(*arguments: str | Path, profile: str | None = None) -> Done:
    """`render still`, in this process: others need not import everything anew."""
    return here("render", "still", *arguments, *SIZE, "--json", *(() if profile is None else ("--profile", profile)))


def here(*arguments: str | Path) -> Done:
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    return Done(code, out.getvalue().encode(), err.getvalue())


def done(*arguments: str | Path, profile: str | None = None) -> Any:
    ended = still(*arguments, profile=profile)
    assert ended.code == 0, ended.err
    return ended.json


def moving_file(folder: Path) -> Path:
    """A triangle that rises by 1 in a second."""
    import base64
    import struct

    corners = struct.pack("<9f", -1, 0, 0, 1, 0, 0, 0, 1, 0)
    moves = struct.pack("<2f6f", 0, 1, 0, 0, 0, 0, 1, 0)
    data = base64.b64encode(corners + moves).decode()
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 68, "uri": f"data:application/octet-stream;base64,{data}"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 8}, {"buffer": 0, "byteOffset": 44, "byteLength": 24}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [-1, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1]},
            {"bufferView": 2, "componentType": 5126, "count": 2, "type": "VEC3"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0, 0.5, 3]}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
        "animations": [
            {"name": "Rise", "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}], "samplers": [{"input": 1, "output": 2}]}
        ],
    }  # fmt: skip
    path = folder / "rises.gltf"
    path.write_text(json.dumps(document))
    return path


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Two nodes that hold the sample scene as "kitchen"."""
    folder = tmp_path_factory.mktemp("running")
    with running("node", "local", "2", "--folder", folder, "--ports", ports_option(*addresses(2)), "--json") as (_, ready):
        imported = scenectl("scene", "import", sample_scene_path(), "--scene", "kitchen", profile=ready["profile"])
        assert imported.code == 0, imported.err
        yield ready["profile"]


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with dask_cluster(2, tmp_path_factory.mktemp("engine")) as address:
        yield address


@needs_dask
def test_three_ways_and_one_table(profile: str, tmp_path: Path) -> None:
    """Of a scene of a cluster, whose keys each worker opens."""
    hashes = set()
    for way in ("spatial", "visual", "temporal"):
        more = ("--pools", "1") if way == "spatial" else ("--threads", "2")
        files = ("-o", tmp_path / f"{way}.exr", "--report", tmp_path / f"{way}.json")
        report = done("--scene", "kitchen", "--partition", way, *more, *files, profile=profile)
        assert json.loads((tmp_path / f"{way}.json").read_text()) == report
        assert report["partition"] == way and report["nodes"] == 2
        assert all(
            node["processor_seconds"] > 0 and node["memory_most"] > 1 << 24 and node["bytes_read"] for node in report["render_nodes"]
        )
        hashes.add(report["image_sha256"])
    assert len(hashes) == 1
    files = [tmp_path / f"{way}.json" for way in ("spatial", "visual", "temporal")]
    compared = here("render", "report", *files, "--json")
    assert compared.code == 0, compared.err
    assert compared.json["same_image"] is True
    spatial, visual, _ = compared.json["renders"]
    assert (spatial["nodes"], visual["nodes"]) == (2, 1)
    assert spatial["bytes_passed"] > 0 == visual["bytes_passed"] and visual["bytes_returned"] > 0
    assert spatial["rounds"] >= 1 and visual["rounds"] is None
    table = here("render", "report", *files)
    assert table.code == 0 and b"efficiency by rounds" in table.out and table.out.count(b"\n") > 15


def test_frames_by_nodes_are_those_of_one_process_and_what_is_shown_no_more_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, (first, second) = moving_file(tmp_path), addresses(2)
    ended: list[str] = []
    end = Scene.end

    async def noted(scene: Scene, **options: Any) -> SceneEnd:
        found = await end(scene, **options)
        ended.append(scene.name)
        return found

    monkeypatch.setattr(Scene, "end", noted)
    # What a scene has taken besides its first frame is too much at once.
    monkeypatch.setattr(still_frames, "GROWTH_MAX", 0)
    report = done(
        file, *SKY, "--nodes", "2", "--ports", ports_option(first, second), "--frames", "0-4", "--fps", "4", "-o", tmp_path / "r.exr",
        "--report", tmp_path / "r.json",
    )  # fmt: skip
    assert ended == ["even-1"]
    assert [frame["frame"] for frame in report["frames"]] == [0, 1, 2, 3, 4] and report["nodes"] == 2
    assert len({frame["image_sha256"] for frame in report["frames"]}) == 5
    assert report["paths"] == 5 * 48 * 27 * 4 and len(report["render_nodes"]) == 2
    for number in (0, 4):
        written = report["frames"][number]
        alone = done(file, *SKY, "--memory", "1GiB", "--frame", str(number), "--fps", "4", "-o", tmp_path / "one.exr")
        assert alone["image_sha256"] == written["image_sha256"]
        assert Path(written["exr"]).exists() and Path(written["png"]).exists()
    compared = here("render", "report", tmp_path / "r.json", "--json")
    assert compared.code == 0 and compared.json["renders"][0]["paths"] == report["paths"]


@needs_dask
def test_frames_of_a_file_are_those_of_stills(tmp_path: Path) -> None:
    file = moving_file(tmp_path)
    report = done(file, *SKY, "--partition", "temporal", "--frames", "0-3", "--fps", "4", "--threads", "2", "-o", tmp_path / "r.exr")
    assert [frame["frame"] for frame in report["frames"]] == [0, 1, 2, 3]
    assert all(Path(frame["exr"]).exists() and Path(frame["png"]).exists() for frame in report["frames"])
    assert report["frames"][3]["exr"] == str(tmp_path / "r.0003.exr")
    assert len({frame["image_sha256"] for frame in report["frames"]}) == 4
    for number in (0, 3):
        one = done(file, *SKY, "--partition", "visual", "--frame", str(number), "--fps", "4", "-o", tmp_path / "one.exr")
        assert one["image_sha256"] == report["frames"][number]["image_sha256"]
    own = done(file, *SKY, "--frame", "3", "--fps", "4", "--nodes", "1", "--ports", ports_option(*addresses(1)), "-o", tmp_path / "own.exr")
    assert own["image_sha256"] == report["frames"][3]["image_sha256"]


@needs_dask
def test_a_dask_cluster_makes_the_same_image(engine: str, profile: str, tmp_path: Path) -> None:
    here = done("--scene", "kitchen", "--partition", "visual", "-o", tmp_path / "here.exr", profile=profile)
    there = done("--scene", "kitchen", "--partition", "visual", "--engine", engine, "-o", tmp_path / "there.exr", profile=profile)
    assert there["image_sha256"] == here["image_sha256"] and there["engine"] == engine
    file = moving_file(tmp_path)
    frames = done(file, *SKY, "--partition", "temporal", "--frames", "0-3", "--engine", engine, "-o", tmp_path / "f.exr")
    assert len(frames["frames"]) == 4 and sum(node["tasks"] for node in frames["render_nodes"]) == 4


@needs_dask
def test_a_worker_that_dies_is_no_end_and_one_after_the_other_is(tmp_path: Path) -> None:
    from scenefold.render.tasks.engine import ClusterEngine, done_by

    with dask_cluster(2, tmp_path) as address:
        engine = ClusterEngine(address, nothing)
        try:
            taken: list[str] = []
            for _ in range(2):
                trio.run(done_by, engine, [partial(dies_once, str(tmp_path / "mark"))], taken.append, offline_world().workers)
            assert taken == ["done", "done"]
            with pytest.raises(LocalFault, match="died one after the other"):
                engine.map([always_dies], taken.append)
        finally:
            engine.close()


@needs_dask
def test_an_engine_that_is_away(monkeypatch: pytest.MonkeyPatch) -> None:
    from scenefold.render.tasks import engine

    monkeypatch.setattr(engine, "CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(Unreachable, match="no Dask scheduler answers") as error:
        engine.ClusterEngine(address, nothing)
    assert error.value.where == address and error.value.remedy


@needs_dask
def test_an_engine_without_the_program_is_one_clear_error(engine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from scenefold.render.tasks.engine import ClusterEngine

    elsewhere = types.ModuleType("known_here_alone")
    task = types.FunctionType(nothing.__code__, {}, "task")
    task.__module__, task.__qualname__ = elsewhere.__name__, "task"
    monkeypatch.setitem(sys.modules, elsewhere.__name__, elsewhere)
    vars(elsewhere)["task"] = task
    reached = ClusterEngine(engine, nothing)
    try:
        with pytest.raises(LocalFault, match=r"known_here_alone|deserialization") as error:
            reached.map([task], lambda _: None)
        assert "same version" in error.value.remedy
    finally:
        reached.close()


@needs_dask
def test_an_engine_by_tls_needs_certificates_that_count() -> None:
    from scenefold.render.tasks.engine import ClusterEngine

    with pytest.raises(LocalFault, match=r"which certificates count.*distributed.comm.tls"):
        ClusterEngine("tls://127.0.0.1:8786", nothing)


@needs_dask
def test_an_engine_without_workers(tmp_path: Path) -> None:
    from scenefold.render.tasks.engine import ClusterEngine

    with dask_cluster(0, tmp_path) as address, pytest.raises(Unreachable, match=r"no worker.*dask worker tcp://"):
        ClusterEngine(address, nothing)


def stands_still(process: int, within_s: float = 10.0) -> bool:
    """Whether all threads of a process stop in time; a signal only asks for that."""
    until = time.monotonic() + within_s
    while time.monotonic() < until:
        threads = Path(f"/proc/{process}/task").glob("*/stat")
        if all(thread.read_text().rsplit(")", 1)[1].split()[0] == "T" for thread in threads):
            return True
        time.sleep(0.01)
    return False


@needs_dask
def test_a_scheduler_that_stands_still_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scenefold.render.tasks import engine as doors

    with dask_cluster(1, tmp_path) as address:
        reached = doors.ClusterEngine(address, nothing)
        scheduler = reached._client.run_on_scheduler(os.getpid)
        monkeypatch.setattr(doors, "ANSWER_S", 1.0)
        os.kill(scheduler, signal.SIGSTOP)
        assert stands_still(scheduler)
        try:
            with pytest.raises(Unreachable, match="has gone"):
                reached._threads()
            reached.close()
        finally:
            os.kill(scheduler, signal.SIGCONT)


@needs_dask
def test_a_file_that_goes_into_a_cluster_first_tells_of_its_import(profile: str, tmp_path: Path) -> None:
    report = done(moving_file(tmp_path), *SKY, "--partition", "visual", "-o", tmp_path / "x.exr", profile=profile)
    assert report["import"]["records"] > 0 and sum(report["records_per_node"].values()) > 0


@needs_dask
def test_what_the_file_does_not_have_is_one_clear_error(tmp_path: Path) -> None:
    file = moving_file(tmp_path)
    frames = ("--partition", "temporal", "--frames", "0-1", "-o", tmp_path / "x.exr")
    assert "'Walk'" in still(file, *frames, "--animation", "Walk").refusal(1)
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "no animation" in still(tmp_path / "a.obj", *frames).refusal(1)
    assert "no camera 'attic'" in still(file, *frames, "--camera", "attic").refusal(1)


@needs_dask
def test_a_scene_that_the_cluster_does_not_have(profile: str, tmp_path: Path) -> None:
    assert "attic" in still("--scene", "attic", "--partition", "visual", "-o", tmp_path / "x.exr", profile=profile).refusal(1)


@needs_dask
def test_an_image_that_was_not_fetched_is_compared_by_its_name(profile: str, tmp_path: Path) -> None:
    begun = here("render", "start", "--scene", "kitchen", *SIZE, "--json", "--profile", profile)
    assert begun.code == 0, begun.err
    name = begun.json["render"]
    assert here("render", "watch", name, "--profile", profile).code == 0
    compared = here("render", "report", name[:8], "--json", "--profile", profile)
    assert compared.code == 0, compared.err
    (row,) = compared.json["renders"]
    assert (row["report"], row["scene"], row["partition"], row["nodes"]) == (name[:8], "kitchen", "spatial", 2)
    fetched = here("render", "fetch", name, "-o", tmp_path / "x.exr", "--report", tmp_path / "x.json", "--profile", profile)
    assert fetched.code == 0, fetched.err
    assert here("render", "report", tmp_path / "x.json").code == 0
    assert "no such render" in here("render", "report", name[:8], "--profile", profile).refusal(1)
