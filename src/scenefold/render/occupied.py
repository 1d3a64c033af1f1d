"""Which voxels of the job's box hold geometry, as each node finds it of what it holds, and all nodes together (specs/28-rebalancing.md, Empty space)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.partition import Partition
from scenefold.render.arrays import F64, U8, EmptySpace, SceneArrays
from scenefold.render.content import cell_margin, pairs_of
from scenefold.render.numbers import job_box
from scenefold.scene.tables import SceneTables

SIDE = 64
"""As kernels have it, which are slow to import."""
BITS_BYTES = SIDE**3 // 8
_LEVEL = 1
"""Of compression: what is sent once to each node is not worth more time."""
_EDGE = 0.25
"""Voxels between the box and the outermost walls: what lies in the box, grown, lies in the voxels."""
_LOST = 2.0**-20
"""Of the largest terms of a place: what single precision may lose of it in a prototype's space, and on the way to the world."""
_FLAT = 1e-9


def voxels(low: F64, high: F64) -> tuple[F64, F64, F64]:
    """The corners of all voxels of a box, and voxels a unit; f64[3] each."""
    # A flat box gets some thickness, and any box enough for the digits of its place.
    sides = np.maximum(high - low, _FLAT * np.maximum(np.abs(low), np.abs(high)).max())
    sides = np.where(sides > 0.0, sides, 1.0)
    per_voxel = (SIDE - 2 * _EDGE) / sides
    begin = low - _EDGE / per_voxel
    return begin, begin + SIDE / per_voxel, per_voxel


def occupied_by(tables: SceneTables, arrays: SceneArrays, partition: Partition, me: int) -> U8:
    """The voxels in which the triangles lie that node `me` of a partition holds, uint8[64, 64, 64]; grown as its cell is."""
    from scenefold.render import occupied_kernels as kernels

    low, _, per_voxel = voxels(*job_box(tables))
    instances, groups = pairs_of(tables, partition, me)
    matrices = arrays.instance_matrices[instances]
    farthest = np.maximum(np.abs(tables.groups.low[groups]), np.abs(tables.groups.high[groups])).astype(np.float64)
    terms = (np.abs(matrices[:, :, :3]) * farthest[:, None, :]).sum(axis=2) + np.abs(matrices[:, :, 3])
    occupied = np.zeros((SIDE, SIDE, SIDE), np.uint8)
    kernels.mark_triangles(
        occupied,
        low,
        per_voxel,
        arrays.vertices,
        arrays.triangles,
        arrays.group_first[groups],
        tables.groups.triangles[groups].astype(np.int64),
        matrices,
        cell_margin(tables) + _LOST * terms.max(axis=1, initial=0.0),
        np.empty((3, 3)),
    )
    return occupied


def empty_space(tables: SceneTables, occupied: U8) -> EmptySpace:
    """What tracers skip by, where these voxels hold all of a scene's geometry."""
    from scenefold.partition.empty_walk_kernels import fill_reach

    reach = np.empty((SIDE, SIDE, SIDE), np.uint8)
    fill_reach(occupied, reach)
    return EmptySpace(reach, *voxels(*job_box(tables)))


def packed(occupied: U8) -> bytes:
    """As they are told."""
    return zlib.compress(np.packbits(occupied.reshape(-1), bitorder="little").tobytes(), _LEVEL)


def united(told: Iterable[object]) -> bytes:
    """What nodes told, as one. PeerFault if one told nothing of that kind."""
    total = np.zeros((SIDE, SIDE, SIDE), np.uint8)
    for one in told:
        total |= unpacked(one)
    return packed(total)


def unpacked(told: object) -> U8:
    """What `packed` gave; PeerFault for anything else."""
    if not isinstance(told, bytes) or len(told) > 2 * BITS_BYTES:
        raise PeerFault("voxels that hold geometry are ill-formed")
    unpacker = zlib.decompressobj()
    try:
        plain = unpacker.decompress(told, BITS_BYTES + 1)
    except zlib.error as error:
        raise PeerFault("voxels that hold geometry are ill-formed", where=str(error)) from error
    if len(plain) != BITS_BYTES or not unpacker.eof or unpacker.unused_data:
        raise PeerFault("voxels that hold geometry are ill-formed", where=f"{len(plain)} bytes")
    return np.unpackbits(np.frombuffer(plain, np.uint8), bitorder="little").reshape(SIDE, SIDE, SIDE)
