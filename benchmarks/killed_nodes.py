"""A render whose nodes are killed again and again: is the image the undisturbed one, and what was traced again?

    python benchmarks/killed_nodes.py --nodes 5 --every 20 --samples 96

A cluster is started in a temporary folder, with copies. The image is rendered once undisturbed, and then again while a node is drawn every so many seconds and
killed with SIGKILL; it is started again at once. `--spare` never draws the one that organises the render. Else the render is begun anew when that one is drawn,
behind what was kept of it. One JSON object is printed, and each kill on the error output.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import trio

from scenefold.client import Cluster, Scene, connect
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.render.client import StillOptions, StillResult, render_still
from scenefold.render.image_files import image_sha256
from scenefold.scene.sample import sample_scene_path


class Killer:
    """Kills nodes while the image is traced."""

    def __init__(self, nodes: LocalCluster, every_s: float, seed: int, *, spare: bool) -> None:
        self._nodes, self._every_s, self._spare, self._dice = nodes, every_s, spare, random.Random(seed)
        self.organiser = ""
        self.is_tracing = False
        self.killed: list[str] = []
        self.organisers = 0

    def progress(self, phase: str, _done: int, _total: int) -> None:
        """As the client hears it."""
        self.is_tracing = phase == "render"

    async def run(self) -> None:
        """Until cancelled."""
        while True:
            await trio.sleep(self._every_s)
            victim = self._dice.choice([one for one in self._nodes.addresses if not self._spare or one != self.organiser])
            process = self._nodes.pid(victim)
            if process is None or not self.is_tracing:
                continue
            self.killed.append(victim)
            self.organisers += victim == self.organiser
            print(f"{time.monotonic():.1f}: {victim} is killed{', which organises' * (victim == self.organiser)}", file=sys.stderr)
            # More deaths are allowed to it than a cluster of its own allows: they are wanted.
            self._nodes.may_die(self._nodes.addresses)
            os.kill(process, signal.SIGKILL)


async def measure(asked: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Both renders, and what they came to."""
    width, height = map(int, asked.size.split("x"))
    options = StillOptions(width=width, height=height, samples=asked.samples)
    async with local_cluster(asked.nodes, folder, threads=1, trust=True) as nodes, connect(nodes.profile) as cluster:
        await cluster.scenes.create("sample", copies=2)
        scene, _ = await cluster.scenes.import_file("sample", asked.scene or sample_scene_path())
        begun = time.monotonic()
        before = await render_still(cluster, scene, options, lambda *_: None)
        undisturbed_s = time.monotonic() - begun
        killer = Killer(nodes, asked.every, asked.seed, spare=asked.spare)
        begun = time.monotonic()
        after = await _disturbed(cluster, scene, options, killer, folder / "kept")
        return {
            "nodes": asked.nodes,
            "passes": before.report["passes"],
            "undisturbed_s": round(undisturbed_s, 1),
            "disturbed_s": round(time.monotonic() - begun, 1),
            "killed": len(killer.killed),
            "organisers_killed": killer.organisers,
            **{name: after.report[name] for name in ("begun", "attempts", "passes_traced_again", "paths_before")},
            "nodes_back": len(after.report["nodes_back"]),
            "same_image": image_sha256(before.layers["beauty"]) == image_sha256(after.layers["beauty"]),
        }


async def _disturbed(cluster: Cluster, scene: Scene, options: StillOptions, killer: Killer, kept: Path) -> StillResult:
    async with trio.open_nursery() as nursery:
        nursery.start_soon(killer.run)
        result = await render_still(
            cluster,
            scene,
            options,
            killer.progress,
            organised_by=lambda address: setattr(killer, "organiser", address),
            lost=lambda address: print(f"{time.monotonic():.1f}: {address} is lost", file=sys.stderr),
            back=lambda address: print(f"{time.monotonic():.1f}: {address} is back", file=sys.stderr),
            anew=lambda why: print(f"{time.monotonic():.1f}: begun anew behind {why.passes} passes: {why.error}", file=sys.stderr),
            resume=kept,
        )
        nursery.cancel_scope.cancel()
    return result


def main() -> None:
    """Measure as the options say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes", type=int, default=5)
    parser.add_argument("--every", type=float, default=20.0, help="seconds between two kills")
    parser.add_argument("--samples", type=int, default=96)
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--scene", type=Path, help="a scene file (default: the sample scene)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spare", action="store_true", help="never kill the node that organises the render")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(trio.run(measure, asked, Path(folder))))


if __name__ == "__main__":
    main()
