"""If this fails, a node's process that is killed while an image is traced ends the render, or changes the image."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import trio

from loopback import free_ports
from scenefold.client import connect
from scenefold.node.local import local_cluster
from scenefold.render.client import StillOptions, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
OPTIONS = StillOptions(width=96, height=72, samples=64)
"""7 passes."""


@pytest.mark.long
@pytest.mark.timeout(300)
async def test_the_image_is_the_same(tmp_path: Path) -> None:
    """Records lie on one node each, as in a cluster that is started for one image: of the dead one, they are read when it runs again."""
    with trio.fail_after(KERNELS_S):
        async with local_cluster(3, tmp_path, ports=free_ports(), threads=1, trust=True) as nodes, connect(nodes.profile) as cluster:
            await cluster.scenes.create("sample", copies=1)
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            undisturbed = await render_still(cluster, scene, OPTIONS, lambda *_: None)
            killed: list[str] = []
            lost: list[str] = []

            def organised_by(address: str) -> None:
                killed[:] = [other for other in nodes.addresses if other != address][:1]
                nodes.may_die(killed)

            def progress(phase: str, done: int, _total: int) -> None:
                process = nodes.pid(killed[0]) if killed and phase == "render" and done else None
                if process is not None and not lost and not died:
                    died.append(process)
                    os.kill(process, signal.SIGKILL)

            died: list[int] = []
            result = await render_still(cluster, scene, OPTIONS, progress, organised_by=organised_by, lost=lost.append)
            assert died and lost == killed == result.report["nodes_lost"]
            assert nodes.pid(killed[0]) != died[0]
    assert image_sha256(result.layers["beauty"]) == image_sha256(undisturbed.layers["beauty"])
    assert result.report["attempts"] == 2
