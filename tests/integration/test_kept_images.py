"""If this fails, a finished image does not stay in its scene, or another one comes back than was saved."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, scenectl
from loopback import free_ports
from scenefold.client import connect
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.scene.sample import sample_scene_path

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""

pytestmark = pytest.mark.timeout(360)


async def said(nodes: LocalCluster, *words: str | Path, scene: str | None = "sample") -> Done:
    more = () if scene is None else ("--scene", scene)

    def say() -> Done:
        return scenectl(*words, *more, "--json", profile=nodes.profile, limit_s=KERNELS_S)

    return await trio.to_thread.run_sync(say)


async def test_an_image_stays_in_its_scene_through_modes_and_keys_until_it_is_deleted(tmp_path: Path) -> None:
    with trio.fail_after(KERNELS_S):
        async with local_cluster(3, tmp_path / "nodes", ports=free_ports(), trust=True) as nodes, connect(nodes.profile) as cluster:
            await cluster.scenes.import_file("sample", sample_scene_path())
            small = ("--size", "48x27", "--samples", "4")
            made = await said(nodes, "render", "still", *small, "-o", tmp_path / "a.exr", "--save", "first")
            assert made.code == 0, made.err
            assert made.json["saved"] == "first"
            assert (await said(nodes, "scene", "mode", "sample", "render", scene=None)).code == 0
            # Also while it is rendered, and by somebody who begins it and comes back.
            begun = await said(nodes, "render", "start", *small, "--seed", "2")
            assert begun.code == 0, begun.err
            fetched = await said(
                nodes, "render", "fetch", begun.json["render"], "--wait", "-o", tmp_path / "b.exr", "--save", "second", scene=None
            )
            assert fetched.code == 0, fetched.err
            assert (await said(nodes, "scene", "mode", "sample", "edit", scene=None)).code == 0
            assert (await said(nodes, "scene", "rotate-key", "sample", scene=None)).code == 0

            listed = await said(nodes, "image", "list")
            assert [(one["image"], one["size"], one["image_sha256"]) for one in listed.json["images"]] == [
                ("first", [48, 27], made.json["image_sha256"]),
                ("second", [48, 27], fetched.json["image_sha256"]),
            ]
            for name, written in (("first", "a.exr"), ("second", "b.exr")):
                got = await said(nodes, "image", "get", name, "-o", tmp_path / "back.exr")
                assert got.code == 0 and (tmp_path / "back.exr").read_bytes() == (tmp_path / written).read_bytes()

            assert (await said(nodes, "image", "save", "first", tmp_path / "b.exr")).json["image_sha256"] == fetched.json["image_sha256"]
            assert (await said(nodes, "image", "rm", "second")).code == 0
            assert [one["image"] for one in (await said(nodes, "image", "list")).json["images"]] == ["first"]
            assert "no image of that name" in (await said(nodes, "image", "get", "second", "-o", tmp_path / "no.exr")).refusal(1)
            assert "no image of that name" in (await said(nodes, "image", "rm", "second")).refusal(1)
            (tmp_path / "text.exr").write_text("no image")
            assert "no OpenEXR image" in (await said(nodes, "image", "save", "third", tmp_path / "text.exr")).refusal(1)
            assert "no such image file" in (await said(nodes, "image", "save", "third", tmp_path / "gone.exr")).refusal(1)
            assert "can be called so" in (await said(nodes, "image", "save", "a/b", tmp_path / "b.exr")).refusal(1)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--save", "final"], 2, "--save keeps an image in a scene of a cluster"),
        (["--save", "a/b", "--profile", "nowhere"], 2, "no image can be called so"),
        (["--save", "final", "--partition", "visual"], 2, "--save"),
    ],
)
def test_what_cannot_be_kept_is_said_before_the_work(tmp_path: Path, words: list[str], code: int, said: str) -> None:
    refused = scenectl("render", "still", sample_scene_path(), "-o", tmp_path / "o.exr", *words, "--json", limit_s=60.0)
    assert said in refused.refusal(code)
