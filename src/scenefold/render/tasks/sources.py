"""Where whoever does a task finds the scene: a name or a path, never a key (specs/32-partitions.md, What is sent).

A task is sent as it is to another computer. So a scene of a cluster is named by a profile that lies there, whose keys are opened there.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.crypto import refuse_to_ask
from scenefold.scene.importers import AT_REST, Moment

if TYPE_CHECKING:
    from scenefold.client import Scene
    from scenefold.crypto.secret_folder import AskPassphrase
    from scenefold.render.pool.share import SceneReader
    from scenefold.world import Workers


class Opened(NamedTuple):
    """A scene that can be read."""

    reader: SceneReader
    not_carried: tuple[str, ...]
    """What a file has that a scene cannot have."""


@dataclass(frozen=True, slots=True)
class SceneFile:
    """A file under the same path wherever a task is done, read there as an import reads it."""

    path: Path
    moment: Moment = AT_REST
    environment: Path | None = None

    @asynccontextmanager
    async def opened(self, workers: Workers) -> AsyncIterator[Opened]:
        """LocalFault if it cannot be used, or has no such animation."""
        from scenefold.render.in_memory import LANE, RecordsInMemory

        records = await workers.run(LANE, RecordsInMemory, self.path, self.environment, self.moment)
        yield Opened(records, records.not_carried)


@dataclass(frozen=True, slots=True)
class ClusterScene:
    """A scene of a cluster, by a profile that lies wherever a task is done."""

    profile: str | None
    """Its name, or its folder; None: the default one."""
    name: str
    ask: AskPassphrase = refuse_to_ask
    """What gives the passphrase of keys that are locked, on the computer where they lie; a function of a module."""

    @asynccontextmanager
    async def opened(self, workers: Workers) -> AsyncIterator[Opened]:
        """LocalFault if there is no such profile or scene, Unreachable or Refused if the cluster does not give it."""
        from scenefold.client import connect

        async with connect(self.profile, self.ask) as cluster:
            yield Opened(_StoredScene(await cluster.scenes.open(self.name)), ())


Source = SceneFile | ClusterScene


@dataclass(frozen=True, slots=True)
class _StoredScene:
    """A `SceneReader` over what a cluster stores, through its client."""

    scene: Scene

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        return await self.scene.space(space).get_many(locations)
