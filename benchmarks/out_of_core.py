"""A scene eight times as large as the memory that may be used: does the budget hold at every moment, is the image the same, what does it cost?

    python benchmarks/out_of_core.py --triangles 4000000 --budget 49 --samples 64

Hills are generated as a PLY file of that many triangles, if no file is named. They are rendered in processes of their own, in turns: with a budget that holds
everything, and with `--budget` MiB. Every 20 ms the kernel is asked how much anonymous and shared memory the process has (RssAnon, RssShmem), and how much
the import has, a process of its own, for which no budget holds. "Scene" is what it takes in memory: arrays, and trees of some 70 bytes a triangle; the run
without bounds has its arrays in mapped files as well, so `whole_most_mib` is program and trees. Ratios are of the rendering alone, by the clock and by the
processor. One JSON object is printed, and each run as it ends on the error output.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np

MIB = 1 << 20
_WHOLE = 16_384
"""MiB: a budget that holds everything."""


def hills(path: Path, triangles: int) -> None:
    """A binary PLY file of a height field with so many triangles, about."""
    cuts = int((triangles / 2) ** 0.5)
    side = np.linspace(-1.0, 1.0, cuts + 1)
    x, z = np.meshgrid(side, side, indexing="ij")
    y = 0.15 * np.sin(5 * x) * np.cos(4 * z) + 0.03 * np.sin(41 * x + 3 * z) * np.sin(37 * z)
    first = (np.arange(cuts)[:, None] * (cuts + 1) + np.arange(cuts)).ravel()
    faces = np.empty(2 * cuts * cuts, np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"] = 3
    faces["corners"][0::2] = np.stack([first, first + 1, first + cuts + 1], 1)
    faces["corners"][1::2] = np.stack([first + 1, first + cuts + 2, first + cuts + 1], 1)
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {x.size}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = np.stack([x, y, z], -1).reshape(-1, 3).astype("<f4")
    path.write_bytes(head.encode() + vertices.tobytes() + faces.tobytes())


def memory_of(process: int) -> int:
    """RssAnon + RssShmem in bytes; 0 when it is gone."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) << 10 for line in lines if line.startswith(("RssAnon:", "RssShmem:")))


def children_of(process: int) -> list[int]:
    """Processes that it started and that still run."""
    try:
        return [int(word) for file in Path(f"/proc/{process}/task").glob("*/children") for word in file.read_text().split()]
    except OSError:
        return []


class Watch:
    """The most memory that a process had, and those that it started, every 20 ms; and its processor seconds at the end."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.most = self.most_of_import = self.looks = 0
        self._process = process
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()

    def end(self) -> None:
        """No more looks."""
        self._ended.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._ended.wait(0.02):
            self.most = max(self.most, memory_of(self._process.pid))
            self.most_of_import = max([self.most_of_import, *map(memory_of, children_of(self._process.pid))])
            self.looks += 1


def processor_seconds() -> float:
    """Of all processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def rendered(file: Path, budget: int, threads: int, arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The report of one render, with the most memory that it had."""
    command = [
        sys.executable, "-m", "scenectl", "render", "still", str(file), "--memory", f"{budget}MiB", "--threads", str(threads),
        "--samples", str(arguments.samples), "--size", arguments.size, "--json", "-o", str(folder / f"{budget}.exr"),
    ]  # fmt: skip
    command += ["--sky", arguments.sky] if arguments.sky else []
    before = processor_seconds()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        watch = Watch(process)
        out, _ = process.communicate()
        watch.end()
    if process.returncode:
        raise SystemExit(f"the render ended with code {process.returncode}")
    report: dict[str, Any] = json.loads(out)
    made = {
        "budget_mib": budget,
        "threads": threads,
        "most_mib": round(watch.most / MIB, 1),
        "most_of_import_mib": round(watch.most_of_import / MIB, 1),
        "looks": watch.looks,
        "holds": watch.most <= (budget + 300) * MIB,
        "seconds": report["seconds"],
        "processor_seconds": {"all": round(processor_seconds() - before, 1), **report["processor_seconds"]},
        "image_sha256": report["image_sha256"],
        "paths": report["paths"],
        "rays": report["rays"],
        "memory": report["memory"],
    }
    print(json.dumps(made), file=sys.stderr, flush=True)
    return made


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, default=4_000_000, help="of the hills, if no file is named")
    parser.add_argument("--file", type=Path, help="a scene")
    parser.add_argument("--budget", type=int, default=49, help="MiB")
    parser.add_argument("--others", default="", help="further budgets in MiB, with commas, for the bits of the image alone")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--sky", default="0.6,0.7,0.9")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--turns", type=int, default=2, help="how often it is rendered in both ways")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = arguments.file or folder / "hills.ply"
        if arguments.file is None:
            hills(file, arguments.triangles)
        both = [
            [rendered(file, budget, arguments.threads, arguments, folder) for budget in (_WHOLE, arguments.budget)]
            for _ in range(arguments.turns)
        ]
        others = [
            rendered(file, int(budget), threads, arguments, folder)
            for budget in filter(None, arguments.others.split(","))
            for threads in (1, 2)
        ]
    runs = [run for turn in both for run in turn] + others
    scene = runs[0]["memory"]["scene_bytes"] / MIB
    print(
        json.dumps(
            {
                "scene_mib": round(scene, 1),
                "scene_by_budget": round(scene / arguments.budget, 2),
                "whole_most_mib": both[0][0]["most_mib"],
                "same_image": len({run["image_sha256"] for run in runs}) == 1,
                "holds": all(run["holds"] for run in runs),
                "time_ratios": [round(within["seconds"]["render"] / whole["seconds"]["render"], 2) for whole, within in both],
                "processor_ratios": [
                    round(within["processor_seconds"]["render"] / whole["processor_seconds"]["render"], 2) for whole, within in both
                ],
                "runs": runs,
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
