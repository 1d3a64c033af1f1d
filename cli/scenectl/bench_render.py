"""What `bench render` does: one thread against the bare Embree rate, then whole clusters against each other.

A cluster renders a few pixels first, so that its kernels are loaded when the clock starts. Processor seconds are
those of the node processes alone, as the kernel counts them.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenectl.output import table
from scenectl.still import Phases
from scenectl.values import cluster_ports

if TYPE_CHECKING:
    from scenectl.values import PortPair
    from scenefold.client.progress import ProgressCallback
    from scenefold.node.local import LocalCluster
    from scenefold.render.client import StillOptions

_WARM_SIDE = 16


@dataclass(frozen=True, kw_only=True)
class RenderBench:
    """What to measure."""

    scene: str
    """A scene file, `sample` or `cornell`."""
    options: StillOptions
    nodes: tuple[int, ...]
    repetitions: int
    ports: PortPair | None


async def bench_render(bench: RenderBench, progress: ProgressCallback) -> dict[str, Any]:
    """Measure and return the report (docs/reference/scenectl.md, *Report of a measurement*)."""
    from scenefold.client import ProgressState
    from scenefold.render.bench import measure_renderer
    from scenefold.world import offline_world

    with _scene_file(bench.scene) as file:
        options = bench.options.checked()
        parts = 1 + len(bench.nodes)
        progress(ProgressState("measure", 0, parts, "parts"))
        report = await measure_renderer(file, options, offline_world().workers, repetitions=bench.repetitions)
        clusters = []
        for part, count in enumerate(bench.nodes, 1):
            progress(ProgressState("measure", part, parts, "parts"))
            clusters.append(await _measure_cluster(file, count, bench))
        progress(ProgressState("measure", parts, parts, "parts"))
    return {
        "scene": bench.scene,
        "size": [options.width, options.height],
        "samples": options.samples,
        "depth": options.depth,
        "one_thread": report,
        "paths_per_s": report["paths_per_s"]["median"],
        "rays_per_s": report["rays_per_s"]["median"],
        "embree_rays_per_s": report["embree_rays_per_s"]["median"],
        "clusters": clusters,
        "cpu_ratio": _cpu_ratio(clusters),
        "same_image": len({cluster["image_sha256"] for cluster in clusters}) <= 1,
    }


def bench_text(report: dict[str, Any]) -> str:
    """The report for people."""
    one = report["one_thread"]
    width, height = report["size"]
    share = ", ".join(f"{name} {value:.0%}" for name, value in one["stage_share"].items())
    lines = [
        f"{report['scene']}, {width}x{height}, {report['samples']} samples, depth {report['depth']}, {one['triangles']:,} triangles",
        "",
        "One thread, per second of processor time:",
        table(("", "median", "least", "most"), [_rate_row(*row) for row in _rates(one)]),
        f"rays per path {one['rays_per_path']:.2f}, time: {share}",
    ]
    if one["processor_share"] < 0.9:
        lines.append(f"The machine was busy: this thread had a processor {one['processor_share']:.0%} of the time.")
    if report["clusters"]:
        titles = ("nodes", "render s", "paths/s", "CPU s", "passed/path", "bytes/path", "efficiency", "image sha256")
        lines += ["", table(titles, [_cluster_row(cluster) for cluster in report["clusters"]])]
        if report["cpu_ratio"] is not None:
            first, last = report["clusters"][0]["nodes"], report["clusters"][-1]["nodes"]
            lines.append(f"CPU seconds, {last} nodes / {first}: {report['cpu_ratio']:.2f}")
        if not report["same_image"]:
            lines.append("The images differ: this should never be.")
    return "\n".join(lines)


def _rates(one: dict[str, Any]) -> list[tuple[str, dict[str, float], bool]]:
    return [
        ("paths", one["paths_per_s"], False),
        ("rays, whole render", one["rays_per_s"], False),
        ("rays, our caster alone", one["caster_rays_per_s"], False),
        ("rays, embreex alone", one["embree_rays_per_s"], False),
        ("kept by the caster", one["caster_kept"], True),
        ("kept end to end", one["kept"], True),
    ]


def _rate_row(label: str, spread: dict[str, float], is_share: bool) -> tuple[str, ...]:
    return (label, *(f"{spread[key]:.1%}" if is_share else f"{spread[key]:,.0f}" for key in ("median", "min", "max")))


def _cluster_row(cluster: dict[str, Any]) -> tuple[str, ...]:
    cpu = cluster["cpu_s"]["render"]
    return (
        str(cluster["nodes"]),
        f"{cluster['seconds']['render']:.2f}",
        f"{cluster['paths_per_s']:,.0f}",
        "-" if cpu is None else f"{cpu:.2f}",
        f"{cluster['rays_passed_per_path']:.2f}",
        f"{cluster['bytes_per_path']:.0f}",
        f"{cluster['efficiency']:.2f}",
        cluster["image_sha256"][:16],
    )


def _cpu_ratio(clusters: Sequence[dict[str, Any]]) -> float | None:
    """Processor seconds of the last cluster's render over the first's."""
    if len(clusters) < 2 or not clusters[0]["cpu_s"]["render"]:
        return None
    last = clusters[-1]["cpu_s"]["render"]
    return None if last is None else float(last / clusters[0]["cpu_s"]["render"])


@contextmanager
def _scene_file(scene: str) -> Iterator[Path]:
    """The file that a scene's name means; a file of this name, if there is one, is not meant."""
    from scenefold.base.errors import LocalFault

    if scene == "sample":
        from scenefold.scene.sample import sample_scene_path

        yield sample_scene_path()
    elif scene == "cornell":
        from scenefold.scene.cornell import cornell_box

        with tempfile.TemporaryDirectory(prefix="scenefold-") as folder:
            file = Path(folder) / "cornell.glb"
            file.write_bytes(cornell_box())
            yield file
    else:
        if not Path(scene).is_file():
            raise LocalFault("there is no such scene file", where=scene, remedy="give a file, or one of: sample, cornell")
        yield Path(scene)


async def _measure_cluster(file: Path, count: int, bench: RenderBench) -> dict[str, Any]:
    from scenefold.client import connect, prepare_import
    from scenefold.client.progress import no_progress
    from scenefold.node.local import local_cluster
    from scenefold.render.client import render_still
    from scenefold.render.image_files import image_sha256
    from scenefold.world import offline_world

    phases = Phases()
    cpu: dict[str, float | None] = {}
    prepared = await prepare_import(offline_world(), file, no_progress)
    begun = time.monotonic()
    async with local_cluster(count, ports=cluster_ports(bench.ports), trust=True) as embedded, connect(embedded.profile) as cluster:
        phases.seconds["start"] = round(time.monotonic() - begun, 3)
        cpu["start"] = used = _cpu_seconds(embedded)
        with phases.time("import"):
            # It ends with its cluster, and copies would only be moved from one process to the other.
            await cluster.scenes.create("bench", copies=1)
            scene, _ = await cluster.scenes.import_prepared("bench", prepared, no_progress)
        cpu["import"], used = _since(used, embedded)
        with phases.time("warm_up"):
            small = replace(bench.options, width=_WARM_SIDE, height=_WARM_SIDE, samples=1)
            await render_still(cluster, scene, small, _silent)
        cpu["warm_up"], used = _since(used, embedded)
        with phases.time("render"):
            result = await render_still(cluster, scene, bench.options, _silent)
        cpu["render"], _ = _since(used, embedded)
        sha256 = await cluster.in_worker("import", image_sha256, result.layers["beauty"])
    report = result.report
    return {
        "nodes": count,
        "seconds": phases.seconds,
        "render_seconds": report["render_seconds"],
        "cpu_s": cpu,
        "paths_per_s": report["paths_per_second"],
        "rays_per_s": report["rays_per_second"],
        "rays_passed_per_path": report["rays_passed_per_path"],
        "bytes_per_path": report["bytes_passed"] / report["paths"],
        "efficiency": report["efficiency"],
        "image_sha256": sha256,
    }


def _silent(phase: str, done: int, total: int) -> None:
    """A progress that costs nothing."""


def _cpu_seconds(embedded: LocalCluster) -> float | None:
    """Processor seconds of all node processes since they began; None where the kernel does not tell."""
    if sys.platform != "linux":
        return None
    tick = os.sysconf("SC_CLK_TCK")
    ticks = 0
    for address in embedded.addresses:
        # The name, in brackets, may hold spaces. Fields 14 and 15 of the line are user and system time.
        fields = Path(f"/proc/{embedded.pid(address)}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / tick


def _since(before: float | None, embedded: LocalCluster) -> tuple[float | None, float | None]:
    """Processor seconds since `before`, and now's count."""
    now = _cpu_seconds(embedded)
    return (None if now is None or before is None else round(now - before, 3)), now
