"""Fetching a node's share of a scene: tables, then the groups of its cell, then the textures that these wear."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Protocol

import numpy as np

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.arrays import JobNumbers
from scenefold.render.content import Share, held_textures, scene_arrays, share_of
from scenefold.render.contract import HeldGroup, HeldScene
from scenefold.render.job import Job
from scenefold.render.numbers import job_numbers
from scenefold.render.pool.whole_scene import own_groups, sum_of_groups
from scenefold.scene.layout import DOCUMENT_LOCATION, GEOMETRY, META, TEXTURES
from scenefold.scene.payloads.document import decode_document
from scenefold.scene.payloads.geometry import GeometryAtom
from scenefold.scene.payloads.tiles import TextureTile, decode_tile
from scenefold.scene.tables import SceneTables
from scenefold.world import Workers

LANE = "render"
"""Worker threads that trace and build trees: as many as the node may render with."""
FILM_LANE = "film"
"""Worker threads that add up passes and films, which must not wait behind a tracer."""

TRIANGLE_BYTES = 200
"""Of a stored triangle: its part of vertices and attributes, itself, and trees (docs/benchmarks.md, *What instances save*)."""
TEXEL_BYTES = 6
"""With its part of the coarser levels."""


class SceneReader(Protocol):
    """Reads and opens a scene's records, wherever they lie."""

    async def get_many(self, space: SpaceId, locations: Sequence[Location]) -> list[bytes | None]:
        """The payloads at these locations, in order; None where nothing lies."""
        ...


@dataclass(frozen=True, slots=True)
class LoadedShare:
    """What a node needs to open a renderer."""

    tables: SceneTables
    numbers: JobNumbers
    share: Share
    held: HeldScene
    bytes_read: int
    digest: bytes
    """What this node adds to the digest of the whole scene (whole_scene.py); empty unless the job's films are kept."""


async def read_tables(reader: SceneReader, workers: Workers) -> SceneTables:
    """A scene's tables; LocalFault if nothing was imported into it yet."""
    (payload,) = await reader.get_many(META, [DOCUMENT_LOCATION])
    if payload is None:
        raise LocalFault("the scene is empty", remedy="import a file into it first: scenectl scene import")
    document = decode_document(payload)
    by_space: dict[SpaceId, list[Location]] = {}
    for space, location in document.locations():
        by_space.setdefault(space, []).append(location)
    found: dict[tuple[SpaceId, Location], bytes | None] = {}
    for space, locations in by_space.items():
        payloads = await reader.get_many(space, locations)
        found.update(((space, location), page) for location, page in zip(locations, payloads, strict=True))
    pages = [found[key] for key in document.locations()]
    return await workers.run(LANE, SceneTables.from_payloads, document, pages)


def held_by(division: Division, place: int) -> tuple[Partition, int]:
    """The cells, and the place among them, by which a node holds geometry, and traces: who is a pool of its own holds all of space."""
    pool = division.pool_at(place)
    return division.pools[pool], place - division.ranges[pool].start


class Promise(Protocol):
    """Asks for memory for a node's share of a scene before it is taken."""

    def __call__(self, needs: int, what: str, remedy: str) -> None:
        """So many bytes, in all. LocalFault or Refused if there are no so many."""
        ...


def promise_anything(needs: int, what: str, remedy: str) -> None:
    """Nobody counts."""


def bytes_of(tables: SceneTables, groups: Sequence[int], textures: Iterable[int]) -> tuple[int, int, int]:
    """What a node takes that holds these groups and textures of a scene, by a rough estimate: bytes, triangles, texels."""
    triangles = int(tables.groups.triangles[np.array(groups, np.int64)].sum(dtype=np.int64))
    texels = sum(tables.textures[texture].width * tables.textures[texture].height for texture in textures)
    return TRIANGLE_BYTES * triangles + TEXEL_BYTES * texels, triangles, texels


def _promise(division: Division, me: int, needs: tuple[int, int, int], promise: Promise) -> None:
    size, triangles, texels = needs
    if len(division.pools) == 1:
        promise(size, f"a cell with {triangles} triangles and {texels} texels of the scene", "render it with more nodes")
    elif held_by(division, me)[0].nodes > 1:
        promise(size, f"a cell with {triangles} triangles and {texels} texels of the scene", "render it in fewer pools (--pools)")
    else:
        promise(size, "the whole scene", "render it in fewer pools (--pools), or with cells (another --algorithm than whole)")


async def load_share(reader: SceneReader, workers: Workers, job: Job, me: int, promise: Promise = promise_anything) -> LoadedShare:
    """Everything that node `me` of a job must hold; DamagedData if the scene is not the job's. What `promise` raises, where that takes too much memory."""
    tables = await read_tables(reader, workers)
    if tables.document.digest != job.content:
        raise DamagedData("the scene changed since the job was made", remedy="start the render again")
    division = job.division
    share = await workers.run(LANE, share_of, tables, *held_by(division, me))
    _promise(division, me, bytes_of(tables, share.groups, ()), promise)
    locations = [location for group in share.groups for location in tables.groups.locations(group)]
    payloads = await reader.get_many(GEOMETRY, locations)
    atoms = await workers.run(LANE, _decode_groups, tables, share, payloads)
    bytes_read = sum(len(payload) for payload in payloads if payload is not None)
    textures = held_textures(tables, atoms)
    _promise(division, me, bytes_of(tables, share.groups, textures), promise)
    spots = [location for texture in textures for location in tables.textures[texture].tiles]
    tile_payloads = await reader.get_many(TEXTURES, spots)
    tiles = await workers.run(LANE, _decode_tiles, tables, textures, tile_payloads)
    bytes_read += sum(len(payload) for payload in tile_payloads if payload is not None)
    digest = await workers.run(LANE, _digest, job, me, tables, share, payloads, atoms, textures, tile_payloads) if job.keeps else b""
    arrays = await workers.run(LANE, scene_arrays, tables, atoms, tiles)
    numbers = await workers.run(LANE, job_numbers, job, tables)
    groups = tuple(HeldGroup(group, int(tables.groups.prototypes[group]), int(tables.groups.triangles[group])) for group in share.groups)
    instances = tuple((instance, int(tables.instances.prototypes[instance])) for instance in share.instances)
    return LoadedShare(tables, numbers, share, HeldScene(arrays, groups, instances), bytes_read, digest)


def _digest(
    job: Job,
    me: int,
    tables: SceneTables,
    share: Share,
    payloads: Sequence[bytes | None],
    atoms: dict[int, list[GeometryAtom]],
    textures: Sequence[int],
    tile_payloads: Sequence[bytes | None],
) -> bytes:
    following, following_tiles = iter(payloads), iter(tile_payloads)
    by_group = {int(group): list(islice(following, len(tables.groups.locations(group)))) for group in share.groups}
    by_texture = {number: list(islice(following_tiles, len(tables.textures[number].tiles))) for number in textures}
    groups = own_groups(tables, *held_by(job.division, me), share.groups)
    return sum_of_groups(tables, groups, by_group, atoms, by_texture)


def _decode_groups(tables: SceneTables, share: Share, payloads: Sequence[bytes | None]) -> dict[int, list[GeometryAtom]]:
    atoms, at = {}, 0
    for group in share.groups:
        count = int(tables.groups.first_atom[group + 1] - tables.groups.first_atom[group])
        atoms[group] = tables.group_atoms(group, payloads[at : at + count])
        at += count
    return atoms


def _decode_tiles(tables: SceneTables, textures: Sequence[int], payloads: Sequence[bytes | None]) -> dict[int, list[TextureTile]]:
    tiles: dict[int, list[TextureTile]] = {}
    following = iter(payloads)
    for number in textures:
        texture = tables.textures[number]
        tiles[number] = []
        for index in range(len(texture.tiles)):
            payload = next(following)
            if payload is None:
                raise DamagedData(f"tile {index} of texture {number} is missing")
            tile = decode_tile(payload)
            left, upper, right, lower = texture.tile_box(index)
            if (tile.texture, tile.tile) != (number, index) or tile.pixels.shape != (lower - upper, right - left, 4):
                raise DamagedData(f"tile {index} of texture {number} is not the one that the table speaks of")
            tiles[number].append(tile)
    return tiles
