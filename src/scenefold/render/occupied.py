"""Which voxels of the job's box hold geometry, as each node finds it of what it holds, and all nodes together (specs/28-rebalancing.md, Empty space)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.partition import Partition
from scenefold.partition.occupancy import GRIDS_SHAPE, SHIFT, nothing_in
from scenefold.render.arrays import U64, EmptySpace, SceneArrays
from scenefold.render.content import cell_margin, pairs_of
from scenefold.render.numbers import job_box
from scenefold.scene.tables import SceneTables

GRIDS_BYTES = 8 * 2 * 128 * 128 * 2
PACKED_BYTES_MAX = GRIDS_BYTES + 1024
_LEVEL = 1
"""Of compression: what is sent once to each node is not worth more time."""


def occupied_by(tables: SceneTables, arrays: SceneArrays, partition: Partition, me: int) -> U64:
    """The voxels in which the triangles lie that node `me` of a partition holds, uint64[2, 128, 128, 2]; grown as its cell is."""
    from scenefold.render import occupied_kernels as kernels

    space = nothing_in(*job_box(tables))
    instances, groups = pairs_of(tables, partition, me)
    kernels.mark_triangles(
        space.grids,
        space.low,
        space.per_voxel,
        np.array(SHIFT),
        arrays.vertices,
        arrays.triangles,
        arrays.group_first[groups],
        tables.groups.triangles[groups].astype(np.int64),
        arrays.instance_matrices[instances],
        float(cell_margin(tables)),
        np.empty((3, 3)),
    )
    return space.grids


def empty_space(tables: SceneTables, grids: U64) -> EmptySpace:
    """What tracers skip by, where these voxels hold all of a scene's geometry."""
    from scenefold.partition.empty_walk_kernels import fill_reach

    space, reach = nothing_in(*job_box(tables)), np.empty((128, 128, 128), np.uint8)
    fill_reach(grids[0], reach)
    return EmptySpace(reach, np.ascontiguousarray(grids[1]), space.low, space.high, space.per_voxel, np.array(SHIFT))


def packed_grids(grids: U64) -> bytes:
    """As they are told."""
    return zlib.compress(grids.astype("<u8").tobytes(), _LEVEL)


def united(told: Iterable[object]) -> bytes:
    """What nodes told, as one. PeerFault if one told nothing of that kind."""
    total = np.zeros(GRIDS_SHAPE, np.uint64)
    for packed in told:
        total |= unpacked_grids(packed)
    return packed_grids(total)


def unpacked_grids(packed: object) -> U64:
    """What `packed_grids` gave; PeerFault for anything else."""
    if not isinstance(packed, bytes) or len(packed) > PACKED_BYTES_MAX:
        raise PeerFault("voxels that hold geometry are ill-formed")
    unpacker = zlib.decompressobj()
    try:
        plain = unpacker.decompress(packed, GRIDS_BYTES + 1)
    except zlib.error as error:
        raise PeerFault("voxels that hold geometry are ill-formed", where=str(error)) from error
    if len(plain) != GRIDS_BYTES or not unpacker.eof or unpacker.unused_data:
        raise PeerFault("voxels that hold geometry are ill-formed", where=f"{len(plain)} bytes")
    return np.frombuffer(plain, "<u8").astype(np.uint64).reshape(GRIDS_SHAPE)
