"""A job on N nodes in one process, without network: each node holds its own share, rays are handed over in memory.

Scenes go the way that imports go, but with small groups, so that nodes of a small scene hold different ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.partition import Partition
from scenefold.render.arrays import F32, I32, I64, NOTHING_KNOWN, U32, EmptySpace
from scenefold.render.content import held_textures, scene_arrays, share_of
from scenefold.render.contract import HeldGroup, HeldScene, OpenScene, Renderer, RoutingTracer, SkippingTracer, Tracer
from scenefold.render.developing import develop
from scenefold.render.film import Film
from scenefold.render.first_cells import first_cells
from scenefold.render.job import Job, RenderOptions
from scenefold.render.layers import Pixels, in_order
from scenefold.render.numbers import camera_numbers, depth_of_box, job_box, job_numbers
from scenefold.render.occupied import empty_space, occupied_by, packed, united, unpacked
from scenefold.render.pass_sums import PassSums
from scenefold.render.sealed_keys import NO_KEYS
from scenefold.render.sum_columns import SumColumns
from scenefold.scene.importers import atoms, prototypes
from scenefold.scene.importers.plan import ImportPlan
from scenefold.scene.importers.source import SourceScene
from scenefold.scene.layout import GEOMETRY, TEXTURES
from scenefold.scene.payloads.tiles import decode_tile
from scenefold.scene.tables import SceneTables

HOPS_MAX = 400
"""Rounds of handing rays over; each is a hop of every ray."""


@dataclass(frozen=True)
class Rendered:
    """What came of a job."""

    radiance: I64
    """int64[paths, 3]"""
    aovs: I32
    film: Film
    layers: dict[str, Pixels]
    counters: I64
    passed: int
    """Rays handed over between nodes."""
    casts: int
    held: tuple[int, ...]
    """Groups that each node held."""

    @property
    def beauty(self) -> F32:
        return self.layers["beauty"]

    @property
    def variance(self) -> F32:
        return self.layers["variance"]


class Rig:
    """A scene that a renderer can render on any number of nodes."""

    def __init__(self, source: SourceScene, renderer: Renderer, group_triangles: int = 40) -> None:
        self._renderer = renderer
        with (
            patch.object(atoms, "GROUP_TRIANGLES_TARGET", group_triangles),
            patch.object(atoms, "ATOM_TRIANGLES_MAX", group_triangles // 4),
            patch.object(prototypes, "BAKED_COPIES_TRIANGLES_MAX", 0),
        ):
            plan = ImportPlan(source)
            self._records = {(item.space, item.location): item.payload for item in plan.items()}
        document = plan.document()
        self.tables = SceneTables.from_payloads(document, [self._records[key] for key in document.locations()])

    def job(self, algorithm: str, nodes: int, partition: Partition | None = None, **options: object) -> Job:
        """A job as the organiser makes it."""
        asked = RenderOptions(**{"width": 24, "height": 24, "samples": 4, "algorithm": algorithm, **options})  # type: ignore[arg-type]
        camera = self.tables.camera(asked.camera)
        assert camera is not None
        if partition is None:
            partition = first_cells(algorithm, nodes, self.tables, camera)
        return Job(
            id=7,
            scene=SceneId(1),
            genesis=bytes(32),
            keys=NO_KEYS,
            content=self.tables.document.digest,
            numeric_class=self._renderer.numeric_class(),
            width=asked.width,
            height=asked.height,
            samples=asked.samples,
            seed=asked.seed,
            frame=0,
            depth=asked.depth,
            sky=asked.sky,
            camera=camera_numbers(camera, asked.width, asked.height),
            nodes=tuple(NodeId(index + 2) for index in range(nodes)),
            partition=partition,
            layers=asked.layers,
            crop=asked.crop,
            lens=asked.lens,
            sampling=asked.sampling,
            environment_rotation=asked.environment_rotation,
            mips=asked.mips,
        )

    def held(self, partition: Partition, me: int) -> HeldScene:
        """What a node holds, and nothing else."""
        share = share_of(self.tables, partition, me)
        groups = {
            group: self.tables.group_atoms(group, [self._records[GEOMETRY, place] for place in self.tables.groups.locations(group)])
            for group in share.groups
        }
        textures = held_textures(self.tables, groups)
        tiles = {
            number: [decode_tile(self._records[TEXTURES, place]) for place in self.tables.textures[number].tiles] for number in textures
        }
        table = self.tables.groups
        return HeldScene(
            scene_arrays(self.tables, groups, tiles),
            tuple(HeldGroup(group, int(table.prototypes[group]), int(table.triangles[group])) for group in share.groups),
            tuple((number, int(self.tables.instances.prototypes[number])) for number in share.instances),
        )

    @contextmanager
    def opened(self, job: Job, partition: Partition | None = None) -> Iterator[list[OpenScene]]:
        """The renderers of all nodes of a job, in the cells of another partition than its first."""
        cells = partition or job.partition
        numbers = job_numbers(job, self.tables)
        scenes = [self._renderer.open(self.held(cells, me), numbers, cells, me) for me in range(len(job.nodes))]
        try:
            yield list(scenes)
        finally:
            for scene in scenes:
                scene.close()

    def render(self, algorithm: str = "voronoi", nodes: int = 1, partition: Partition | None = None, **options: object) -> Rendered:
        """The whole job."""
        return self.run(self.job(algorithm, nodes, partition, **options))

    def empty_space(self, partition: Partition) -> EmptySpace:
        """As nodes find it together."""
        nodes = range(partition.nodes)
        told = (packed(occupied_by(self.tables, self.held(partition, me).arrays, partition, me)) for me in nodes)
        return empty_space(self.tables, unpacked(united(told)))

    def run(self, job: Job, shuffle: np.random.Generator | None = None, piece: int = 1 << 30, *, skips: bool = False) -> Rendered:
        """The whole job; with `shuffle`, batches are mixed and cut into pieces of at most `piece` rays. `skips`: over cells that are empty."""
        nodes, plan = len(job.nodes), job.plan
        stride = job_numbers(job, self.tables).stride
        film, radiance, aovs = Film(job.window.width, job.window.height, job.columns), [], []
        counters, passed, casts = np.zeros(3, np.int64), 0, 0
        with self.opened(job) as scenes:
            tracers = [scene.tracers(1)[0] for scene in scenes]
            empty = self.empty_space(job.partition) if skips else NOTHING_KNOWN
            for tracer in tracers:
                if skips and isinstance(tracer, SkippingTracer):
                    tracer.skip(empty)
            for number in range(plan.count):
                first, count = plan.first_path(number), plan.size(number)
                assert count <= PASS_PATHS_MAX
                flight = Flight(tracers, first, count, job.columns)
                flight.land(tracers[number % nodes].generate(first, count), shuffle, piece)
                film.add(flight.total, first, stride)
                radiance.append(flight.total.radiance)
                aovs.append(flight.total.aovs)
                counters += flight.total.counters
                passed, casts = passed + flight.passed, casts + flight.casts
        held = tuple(len(share_of(self.tables, job.partition, me).groups) for me in range(nodes))
        box = job_box(self.tables)
        layers = develop(film, in_order((*job.layers, "variance")), box, depth_of_box(job.camera, box))
        return Rendered(np.concatenate(radiance), np.concatenate(aovs), film, layers, counters, passed, casts, held)

    def run_moving(self, job: Job, cells: Sequence[Partition]) -> I64:
        """The job's one pass, with cells that move after each time that rays were handed over; int64[paths, 3 or 9], its radiance."""
        assert job.plan.count == 1
        count = job.plan.size(0)
        with ExitStack() as stack:
            opened = [stack.enter_context(self.opened(job, partition)) for partition in (job.partition, *cells)]
            tracers = [[scene.tracers(1)[0] for scene in scenes] for scenes in opened]
            flight = Flight(tracers[0], 0, count, job.columns)
            flight.land(tracers[0][0].generate(0, count), moves=tracers[1:])
            return flight.total.radiance


class Flight:
    """One pass in the air."""

    def __init__(self, tracers: list[Tracer], first: int, count: int, columns: SumColumns) -> None:
        self._tracers, self._first, self._count, self._columns = tracers, first, count, columns
        self._sums = [PassSums.zeros(count, columns) for _ in tracers]
        self.passed = self.casts = 0

    def land(
        self,
        waiting: dict[int, U32],
        shuffle: np.random.Generator | None = None,
        piece: int = 1 << 30,
        moves: Sequence[Sequence[Tracer]] = (),
    ) -> None:
        """Hand rays over until none is left. `moves`: all nodes' tracers by later partitions, one more with each time."""
        created, retired, hops, later = sum(len(rays) for rays in waiting.values()), 0, 0, list(moves)
        while waiting:
            hops += 1
            assert hops <= HOPS_MAX, "rays fly to and fro"
            leaving: dict[int, list[U32]] = {}
            for node, rays in waiting.items():
                for batch in _pieces(rays, shuffle, piece):
                    outcome = self._tracers[node].advance(batch, self._first, self._sums[node])
                    created, retired = created + outcome.created, retired + outcome.retired
                    self.casts += outcome.casts
                    for target, some in outcome.leaving.items():
                        assert target != node
                        leaving.setdefault(target, []).append(some.copy())
                        self.passed += len(some)
            waiting = {node: np.concatenate(batches) for node, batches in leaving.items()}
            if later and waiting:
                self._tracers = list(later.pop(0))
                waiting = self._addressed_anew(np.concatenate(list(waiting.values())))
        assert created == retired

    def _addressed_anew(self, rays: U32) -> dict[int, U32]:
        tracer = self._tracers[0]
        assert isinstance(tracer, RoutingTracer)
        return tracer.route(rays)

    @property
    def total(self) -> PassSums:
        """All nodes' sums, as they travel."""
        total = PassSums.zeros(self._count, self._columns)
        for each in self._sums:
            total.add_bytes(each.to_bytes())
        return total


def _pieces(rays: U32, shuffle: np.random.Generator | None, piece: int) -> Iterator[U32]:
    order: npt.NDArray[np.int64] = np.arange(len(rays)) if shuffle is None else shuffle.permutation(len(rays))
    for start in range(0, len(rays), piece):
        yield rays[order[start : start + piece]]
