"""A scene file without a cluster: its records in a dictionary, and a job of one node over them.

For measurements and tests of renderers. Everything between file and pixels is the same code as on a node,
apart from store and network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.partition import Partition
from scenefold.render.first_cells import first_cells
from scenefold.render.job import Job, RenderOptions
from scenefold.render.numbers import camera_numbers
from scenefold.render.pool.share import LoadedShare, load_share, read_tables
from scenefold.render.sealed_keys import NO_KEYS
from scenefold.scene.importers import AT_REST, Moment, plan_import, read_scene
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.tables import SceneTables
from scenefold.world import Workers

LANE = "render"


class RecordsInMemory:
    """A `SceneReader` over a file's records."""

    def __init__(self, file: Path, environment: Path | None = None, moment: Moment = AT_REST) -> None:
        self._records: dict[tuple[SpaceId, Location], bytes] = {}
        plan = plan_import(read_scene(file, moment, environment))
        self.not_carried: tuple[str, ...] = tuple(plan.not_carried)
        """What the file has that a scene cannot have."""
        for phase in plan.phases():
            for item in phase:
                place: Location | None = item.location
                while place is not None and (item.space, place) in self._records:
                    place = place.next()
                assert place is not None
                if place != item.location:
                    plan.moved(item, place)
                self._records[item.space, place] = item.payload

    @property
    def records(self) -> Mapping[tuple[SpaceId, Location], bytes]:
        """All of them, by their places."""
        return self._records

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        """See `SceneReader`."""
        return [self._records.get((space, location)) for location in locations]


@dataclass(frozen=True, slots=True)
class OneNodeJob:
    """A job whose only node holds the whole scene."""

    job: Job
    loaded: LoadedShare


async def one_node_job(
    file: Path, options: RenderOptions, numeric_class: str, workers: Workers, environment: Path | None = None
) -> OneNodeJob:
    """Read a scene file and make a job of one node over it, under the map of another one; LocalFault if a file cannot be used."""
    options.check()
    reader = await workers.run(LANE, RecordsInMemory, file, environment)
    tables = await read_tables(reader, workers)
    camera = camera_of(tables, options)
    partition = first_cells(options.algorithm, 1, tables, camera)
    job = job_of(tables, options, numeric_class, partition)
    return OneNodeJob(job, await load_share(reader, workers, job, 0))


def camera_of(tables: SceneTables, options: RenderOptions) -> Camera:
    """The camera that is asked for; LocalFault if the scene has none of that name."""
    camera = tables.camera(options.camera)
    if camera is None:
        raise LocalFault(f"the scene has no camera {options.camera!r}", where="camera", remedy="choose one that it has")
    return camera


def job_of(tables: SceneTables, options: RenderOptions, numeric_class: str, partition: Partition) -> Job:
    """A job whose nodes are all in this process; LocalFault if the scene lacks the camera."""
    return Job(
        id=1,
        scene=SceneId(1),
        genesis=bytes(32),
        keys=NO_KEYS,
        content=tables.document.digest,
        numeric_class=numeric_class,
        width=options.width,
        height=options.height,
        samples=options.samples,
        seed=options.seed,
        frame=0,
        depth=options.depth,
        sky=options.sky,
        camera=camera_numbers(camera_of(tables, options), options.width, options.height),
        nodes=tuple(NodeId(index + 1) for index in range(partition.nodes)),
        partition=partition,
        layers=options.layers,
        crop=options.crop,
        lens=options.lens,
        sampling=options.sampling,
        environment_rotation=options.environment_rotation,
        adaptive=options.adaptive,
        mips=options.mips,
    )
