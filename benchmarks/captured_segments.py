"""The segments of a real scene's paths, for `replay_partitions.py`: what the project's own renderer casts, and where Embree says that it ends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trio
from embreex.rtcore_scene import EmbreeScene

from scenefold.render.arrays import U32
from scenefold.render.content import pair_boxes
from scenefold.render.contract import load_renderer
from scenefold.render.first_cells import first_cells
from scenefold.render.in_memory import RecordsInMemory, camera_of, job_of
from scenefold.render.job import RenderOptions
from scenefold.render.numbers import job_box
from scenefold.render.pass_sums import PassSums
from scenefold.render.passes import PassPlan
from scenefold.render.pool.share import load_share, read_tables
from scenefold.render.renderers.embree.bare import BareBatch, bare_batch, bare_scene
from scenefold.render.renderers.embree.geometry import HeldGeometry
from scenefold.render.renderers.embree.measuring import StagedTracer
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.tables import SceneTables
from scenefold.world import offline_world

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Segments:
    """Straight parts of paths and of shadow rays, in the order of passes, shuffled within each."""

    origins: Floats
    """[n, 3]"""
    directions: Floats
    """[n, 3], of any length."""
    reaches: Floats
    """[n]: where it ends, in lengths of its direction: at what it hits, at its light, or at the scene's box."""
    hits: npt.NDArray[np.bool_]
    """[n]: whether it ends at something."""

    def __len__(self) -> int:
        return len(self.reaches)

    def part(self, begin: int, end: int) -> Segments:
        """Those from one to another."""
        return Segments(self.origins[begin:end], self.directions[begin:end], self.reaches[begin:end], self.hits[begin:end])

    @property
    def ends(self) -> Floats:
        """[m, 3]: where those end that hit something."""
        return self.origins[self.hits] + self.reaches[self.hits, None] * self.directions[self.hits]


@dataclass(frozen=True, slots=True)
class Scene:
    """What is cut into cells."""

    tables: SceneTables
    camera: Camera
    box: Floats
    """[2, 3]"""
    geometry: Floats
    """[m, 2, 3]: boxes of what it is made of."""


def captured(file: Path, options: RenderOptions, most: int) -> tuple[Scene, Segments]:
    """About `most` segments of an image, by one thread. LocalFault if the file cannot be used."""

    async def capture() -> tuple[Scene, Segments]:
        workers = offline_world().workers
        reader = RecordsInMemory(file)
        tables = await read_tables(reader, workers)
        camera = camera_of(tables, options)
        cells = first_cells("voronoi", 1, tables, camera)
        job = job_of(tables, options, load_renderer("embree").numeric_class(), cells)
        loaded = await load_share(reader, workers, job, 0)
        geometry = HeldGeometry(loaded.held)
        try:
            tracer = StagedTracer(loaded.held.arrays, geometry, loaded.numbers, cells, 0)
            rays = _cast(tracer, options, most)
        finally:
            geometry.close()
        box = np.stack(job_box(tables)).astype(np.float64)
        _, _, low, high = pair_boxes(tables)
        scene = Scene(tables, camera, box, np.concatenate([box[None], np.stack([low, high], axis=1)]))
        return scene, _segments(bare_scene(loaded.held), rays, box)

    return trio.run(capture)


def _cast(tracer: StagedTracer, options: RenderOptions, most: int) -> list[list[U32]]:
    """What each pass casts."""
    plan, passes, count = PassPlan(options.seed, options.window.pixels * options.samples), list[list[U32]](), 0
    for number in range(plan.count):
        tracer.kept = []
        first, size = plan.first_path(number), plan.size(number)
        sums = PassSums.zeros(size)
        for rays in tracer.generate(first, size).values():
            tracer.advance(rays, first, sums)
        # Rays that miss the scene's box are none of any cell.
        passes.append([rays[(rays[:, 8] >> np.uint32(16)) < 65535] for _, rays in tracer.kept])
        count += sum(map(len, passes[-1]))
        if count >= most:
            break
    return passes


def _segments(scene: EmbreeScene, passes: list[list[U32]], box: Floats) -> Segments:
    dice, parts = np.random.default_rng(7), list[Segments]()
    for batches in passes:
        all_of = [_ends(scene, bare_batch(rays), box) for rays in batches if len(rays)]
        columns = [np.concatenate([getattr(one, name) for one in all_of]) for name in Segments.__slots__]
        order = dice.permutation(len(columns[0]))
        parts.append(Segments(*(column[order] for column in columns)))
    return Segments(*(np.concatenate([getattr(part, name) for part in parts]) for name in Segments.__slots__))


def _ends(scene: EmbreeScene, batch: BareBatch, box: Floats) -> Segments:
    found = []
    if len(batch.path_origins):
        found.append((batch.path_origins, batch.path_directions, np.full(len(batch.path_origins), np.float32(1e30))))
    if len(batch.shadow_origins):
        found.append((batch.shadow_origins, batch.shadow_directions, batch.reaches))
    origins, directions, farthest = (np.concatenate(column) for column in zip(*found, strict=True))
    distances = np.asarray(scene.run(origins, directions, farthest.copy(), query="DISTANCE"), np.float64)
    hits = distances < farthest.astype(np.float64) * (1.0 - 1e-6)
    start, way = origins.astype(np.float64), directions.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(way > 0.0, box[1] - start, box[0] - start) / way
    leaves = np.where(way != 0.0, np.maximum(walls, 0.0), np.inf).min(axis=1)
    return Segments(start, way, np.minimum(distances, leaves), hits)
