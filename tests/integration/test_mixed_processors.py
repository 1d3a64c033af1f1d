"""If this fails, one processor that rounds otherwise spoils an image, or keeps all others from rendering (specs/19-jobs.md)."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import trio

from integration.rounding_node import VARIABLE
from loopback import addresses, free_ports
from scenefold.client import connect
from scenefold.node.local import local_cluster
from scenefold.render.anew import Begun
from scenefold.render.choice import OTHER_CLASS
from scenefold.render.client import StillOptions, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path

TESTS = Path(__file__).parent.parent
NODES = addresses(3)
SMALL = StillOptions(width=48, height=27, samples=4)

pytestmark = pytest.mark.timeout(360)


async def test_the_others_render_without_a_processor_that_rounds_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever of them organises it at first, at last those do that are most."""
    odd = NODES[1]
    monkeypatch.setenv(VARIABLE, odd)
    monkeypatch.setenv("PYTHONPATH", str(TESTS), prepend=os.pathsep)
    with trio.fail_after(240):
        running = local_cluster(3, tmp_path, ports=free_ports(), module="integration.rounding_node", trust=True)
        async with running as nodes, connect(nodes.profile) as cluster:
            scene, _ = await cluster.scenes.import_file("sample", sample_scene_path())
            hashes, classes = set[str](), set[str]()
            for _ in range(3):
                anew = list[Begun]()
                result = await render_still(cluster, scene, SMALL, lambda *_: None, anew=anew.append)
                assert [node["address"] for node in result.report["render_nodes"]] == [NODES[0], NODES[2]]
                assert result.report["left_out"] == [{"address": odd, "why": OTHER_CLASS}]
                assert result.report["begun"] == 2 and [begun.without for begun in anew] == [(odd,)]
                assert "renders in another numeric class" in anew[0].error.what
                hashes.add(image_sha256(result.layers["beauty"]))
                classes.add(result.report["numeric_class"])
            assert len(hashes) == len(classes) == 1
