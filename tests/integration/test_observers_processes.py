"""If this fails, nodes that observe a scene render it otherwise, or not at all, or keep its mode from being changed although they are gone."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, scenectl
from loopback import addresses, free_ports
from scenefold.client import Cluster, Scene, connect
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.render.client import StillOptions, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path

COUNT = 4
KERNELS_S = 280.0
"""The first render after a change of the kernels compiles them."""
SMALL = StillOptions(width=48, height=27, samples=4)

pytestmark = pytest.mark.timeout(360)


class Farm:
    """Three nodes decide a scene, and the fourth renders it, too."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster, scene: Scene) -> None:
        self.nodes, self.cluster, self.scene = nodes, cluster, scene

    async def run(self, *arguments: str) -> Done:
        return await trio.to_thread.run_sync(lambda: scenectl("scene", *arguments, "--json", profile=self.nodes.profile))

    async def done(self, *arguments: str) -> Done:
        done = await self.run(*arguments)
        assert done.code == 0, done.err
        return done

    async def image(self) -> str:
        result = await render_still(self.cluster, self.scene, SMALL, lambda *_: None)
        assert sorted(node["address"] for node in result.report["render_nodes"]) == sorted(self.nodes.addresses)
        return image_sha256(result.layers["beauty"])


async def test_an_observer_renders_in_render_mode_and_is_asked_while_it_lives(tmp_path: Path) -> None:
    with trio.fail_after(KERNELS_S):
        async with (
            local_cluster(COUNT, tmp_path, ports=free_ports(addresses(COUNT)), trust=True) as nodes,
            connect(nodes.profile) as cluster,
        ):
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            farm, observer = Farm(nodes, cluster, scene), nodes.addresses[3]
            assert (await farm.done("participants", "sample")).json["decided_by"] == list(nodes.addresses[:3])
            refused = await farm.run("add-observer", "sample", nodes.addresses[0])
            assert "decides the scene's log" in refused.refusal(1)
            told = (await farm.done("add-observer", "sample", observer)).json
            assert (told["observers"], told["majority"]) == ([observer], 2)
            picture = await farm.image()
            assert (await farm.done("mode", "sample", "render")).json["mode"] == "render"
            await scene.access.refresh()
            assert await farm.image() == picture, "the same, under a lease of its own"
            assert (await farm.done("mode", "sample", "edit")).json["active"] is True
            await nodes.kill(observer)
            forced = await farm.run("mode", "sample", "render", "--force")
            assert forced.code in (0, 3) and forced.json["mode"] == "render", forced.err
            assert (await farm.done("remove-observer", "sample", observer)).json["observers"] == []
            again = await farm.run("remove-observer", "sample", observer)
            assert "does not observe the scene" in again.refusal(1)
