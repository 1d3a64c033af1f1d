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
from scenefold.render.anew import Begun, may_pass
from scenefold.render.client import StillOptions, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
OPTIONS = StillOptions(width=96, height=72, samples=64)
"""7 passes."""


@pytest.mark.parametrize("victim", [pytest.param("another", marks=pytest.mark.long), "organiser"])
@pytest.mark.timeout(300)
async def test_the_image_is_the_same(tmp_path: Path, victim: str) -> None:
    """Records lie on one node each, as in a cluster that is started for one image: of the dead one, they are read when it runs again."""
    with trio.fail_after(KERNELS_S):
        async with local_cluster(3, tmp_path, ports=free_ports(), threads=1, trust=True) as nodes, connect(nodes.profile) as cluster:
            await cluster.scenes.create("sample", copies=1)
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            undisturbed = await render_still(cluster, scene, OPTIONS, lambda *_: None)
            chosen: list[str] = []
            died: list[int] = []
            lost: list[str] = []
            anew: list[Begun] = []

            def organised_by(address: str) -> None:
                if not died:
                    chosen[:] = [other for other in nodes.addresses if (other == address) == (victim == "organiser")][:1]
                    nodes.may_die(chosen)

            def progress(phase: str, done: int, _total: int) -> None:
                process = nodes.pid(chosen[0]) if chosen and phase == "render" and done else None
                if process is not None and not died:
                    died.append(process)
                    os.kill(process, signal.SIGKILL)

            result = await render_still(cluster, scene, OPTIONS, progress, organised_by=organised_by, lost=lost.append, anew=anew.append)
            assert died and nodes.pid(chosen[0]) != died[0]
    assert image_sha256(result.layers["beauty"]) == image_sha256(undisturbed.layers["beauty"])
    if victim == "organiser":
        assert result.report["begun"] == 1 + len(anew) >= 2
        # It may run again by the time that the client asks for the next time.
        assert may_pass(anew[0].error) and "that organise" in anew[0].error.what and anew[0].error.where == chosen[0]
    else:
        assert lost == chosen == result.report["nodes_lost"]
        assert (result.report["attempts"], result.report["begun"], anew) == (2, 1, [])
