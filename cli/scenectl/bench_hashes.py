"""What `bench hashes` does: one image by many pools in this process, and the table of their hashes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenectl.output import table

ALL = "all"


@dataclass(frozen=True, kw_only=True)
class HashesBench:
    """What to render, and by whom."""

    files: tuple[Path, ...]
    """None: the scene that the project brings along."""
    width: int
    height: int
    samples: int
    sky: tuple[float, float, float]
    nodes: tuple[int, ...]
    algorithms: tuple[str, ...]


def algorithms_of(names: str) -> tuple[str, ...]:
    """Those between commas; UsageFault if one does not exist. `all`: those that move cells."""
    from scenefold.base.errors import UsageFault
    from scenefold.render.algorithms import ALGORITHMS, RESTING, WHOLE, check_algorithm

    if names == ALL:
        return tuple(name for name in ALGORITHMS if name not in (RESTING, WHOLE))
    found = tuple(names.split(","))
    for name in found:
        check_algorithm(name)
    if WHOLE in found:
        raise UsageFault(
            f"{WHOLE} has no cells", where="algorithm", remedy="name algorithms that cut space; its bits are tested by themselves"
        )
    return found


async def bench_hashes(bench: HashesBench, said: Callable[[str], object]) -> dict[str, Any]:
    """Render and return the report (docs/reference/scenectl.md); each row is `said` as it comes."""
    from scenefold.render.job import RenderOptions
    from scenefold.render.rehearsal.hashes import Contract, Mishap
    from scenefold.render.rehearsal.pool import records_of
    from scenefold.scene.sample import sample_scene_path
    from scenefold.world import offline_world

    options = RenderOptions(width=bench.width, height=bench.height, samples=bench.samples, sky=bench.sky, algorithm=bench.algorithms[0])
    options.check()
    world = offline_world()
    scenes: list[dict[str, Any]] = []
    for file in bench.files or (sample_scene_path(),):
        records = await world.workers.run("import", records_of, file)
        rows = []
        async for row in Contract(world, records, options).rows(bench.nodes, bench.algorithms, list(Mishap)):
            rows.append(row.document())
            said(_row_text(file, rows[-1]))
        scenes.append({"scene": str(file) if bench.files else "sample", "rows": rows, "hashes": len({row["image_sha256"] for row in rows})})
    return {
        "size": [bench.width, bench.height],
        "samples": bench.samples,
        "scenes": scenes,
        "rows": sum(len(scene["rows"]) for scene in scenes),
        "broken": sum(bool(row["broken"]) for scene in scenes for row in scene["rows"]),
    }


def _row_text(file: Path, row: dict[str, Any]) -> str:
    broken = f": {row['broken'].upper()}" if row["broken"] else ""
    kind = f"{row['nodes']} nodes, {row['algorithm']}, {row['cells']} cells, {row['mishap']}"
    return f"{file.name}: {kind}: {row['image_sha256'][:12]}{broken}"


def bench_text(report: dict[str, Any]) -> str:
    """The report for people: of each scene a line for each number of nodes, and what is broken."""
    lines = []
    for scene in report["scenes"]:
        counts = sorted({row["nodes"] for row in scene["rows"]})
        rows = []
        for count in counts:
            mine = [row for row in scene["rows"] if row["nodes"] == count]
            shares = [row["largest_share"] for row in mine if row["largest_share"] is not None]
            rows.append((
                str(count),
                str(len(mine)),
                ", ".join(sorted({row["image_sha256"][:12] for row in mine})),
                f"{min(row['rays_passed_per_path'] for row in mine):.2f}",
                f"{max(shares, default=0.0):.2f}",
                str(sum(row["cells_moved"] for row in mine)),
                str(sum(row["nodes_lost"] for row in mine)),
            ))  # fmt: skip
        lines.append(f"{scene['scene']}: {scene['hashes']} {'hash' if scene['hashes'] == 1 else 'hashes'} in {len(scene['rows'])} renders")
        lines.append(table(("nodes", "renders", "image sha256", "fewest rays passed/path", "largest share", "moves", "nodes lost"), rows))
        unmoved = {row["algorithm"] for row in scene["rows"]} - {row["algorithm"] for row in scene["rows"] if row["cells_moved"]}
        if unmoved:
            lines.append(f"  cells never moved by: {', '.join(sorted(unmoved))}")
        lines += [f"  broken: {row['broken']}: {row}" for row in scene["rows"] if row["broken"]]
    return "\n".join(lines)
