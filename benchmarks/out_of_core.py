"""A scene eight times as large as the memory that may be used: does the budget hold at every moment, is the image the same, what does it cost?

    python benchmarks/out_of_core.py --triangles 4000000 --budget 96 --samples 64

Hills are generated as a PLY file of that many triangles. The file is rendered in processes of their own: once with a budget that holds everything, once
with `--budget` MiB. Every 50 ms the kernel is asked how much anonymous and shared memory the process has (RssAnon, RssShmem); the import,
a process of its own, is not counted. One JSON object is printed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np

MIB = 1 << 20


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


def rendered(file: Path, budget: int, arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """The report of one render, with the most memory that it had."""
    command = [
        sys.executable, "-m", "scenectl", "render", "still", str(file), "--memory", f"{budget}MiB", "--threads", str(arguments.threads),
        "--samples", str(arguments.samples), "--size", arguments.size, "--sky", "0.6,0.7,0.9", "--json", "-o", str(folder / f"{budget}.exr"),
    ]  # fmt: skip
    most = 0
    ended = threading.Event()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:

        def watch() -> None:
            nonlocal most
            while not ended.wait(0.05):
                most = max(most, memory_of(process.pid))

        watcher = threading.Thread(target=watch)
        watcher.start()
        out, _ = process.communicate()
        ended.set()
        watcher.join()
    if process.returncode:
        raise SystemExit(f"the render ended with code {process.returncode}")
    report: dict[str, Any] = json.loads(out)
    return {
        "budget_mib": budget,
        "most_mib": round(most / MIB, 1),
        "holds": most <= (budget + 300) * MIB,
        "seconds": report["seconds"],
        "image_sha256": report["image_sha256"],
        "paths": report["paths"],
        "memory": report["memory"],
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, default=4_000_000)
    parser.add_argument("--budget", type=int, default=96, help="MiB")
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hills(folder / "hills.ply", arguments.triangles)
        whole = rendered(folder / "hills.ply", 16_384, arguments, folder)
        within = rendered(folder / "hills.ply", arguments.budget, arguments, folder)
    scene = within["memory"]["scene_bytes"] / MIB
    print(
        json.dumps(
            {
                "triangles": arguments.triangles,
                "scene_mib": round(scene, 1),
                "scene_by_budget": round(scene / arguments.budget, 2),
                "same_image": whole["image_sha256"] == within["image_sha256"],
                "time_ratio": round(within["seconds"]["render"] / whole["seconds"]["render"], 2),
                "whole": whole,
                "within": within,
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
