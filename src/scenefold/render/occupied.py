"""Which voxels of the job's box hold geometry, as each node finds it of what it holds, and all nodes together (specs/28-rebalancing.md, Empty space)."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenefold.base.errors import PeerFault
from scenefold.partition import Partition
from scenefold.render.arrays import F64, I64, U8, EmptySpace, SceneArrays
from scenefold.render.content import cell_margin, pairs_of
from scenefold.render.numbers import job_box
from scenefold.scene.tables import SceneTables, instance_groups

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
SLIM_MAX = 4.0
"""Voxels of a box that is flatter are no flatter than that, or its triangles would span many, and take long to mark."""
PIECE_TRIANGLES = 1 << 22
"""What a worker marks at a time: about half a second, since it cannot be interrupted."""


def voxels(low: F64, high: F64) -> tuple[F64, F64, F64]:
    """The corners of all voxels of a box, and voxels a unit; f64[3] each."""
    # A flat box gets some thickness, and any box enough for the digits of its place.
    sides = np.maximum(high - low, _FLAT * np.maximum(np.abs(low), np.abs(high)).max())
    sides = np.where(sides > 0.0, sides, 1.0)
    sides = np.maximum(sides, sides.max() / SLIM_MAX)
    per_voxel = (SIDE - 2 * _EDGE) / sides
    begin = low - _EDGE / per_voxel
    return begin, begin + SIDE / per_voxel, per_voxel


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of an instance and a group, with what their triangles are marked by."""

    groups: I64
    matrices: F64
    """f64[k, 3, 4], to the world."""
    dilations: F64
    """f64[k]"""


def frame_of(tables: SceneTables) -> tuple[F64, F64, F64]:
    """`voxels` of the job's box, grown by what any pair is: equal on every node."""
    low, high = job_box(tables)
    most = float(_pairs(tables, *instance_groups(tables.groups, tables.instances)).dilations.max(initial=0.0))
    return voxels(low - most, high + most)


def pieces_of(tables: SceneTables, partition: Partition, me: int) -> list[Pairs]:
    """What node `me` of a partition holds, in pieces that take a moment each."""
    instances, groups = pairs_of(tables, partition, me)
    piece = np.cumsum(tables.groups.triangles[groups].astype(np.int64)) // PIECE_TRIANGLES
    starts = [0, *(np.flatnonzero(np.diff(piece)) + 1).tolist(), len(groups)]
    return [_pairs(tables, instances[first:end], groups[first:end]) for first, end in pairwise(starts) if first < end]


def nothing_occupied() -> U8:
    """uint8[64, 64, 64], to be marked."""
    return np.zeros((SIDE, SIDE, SIDE), np.uint8)


def mark(occupied: U8, tables: SceneTables, arrays: SceneArrays, pairs: Pairs) -> None:
    """Mark the voxels in which the triangles of some pairs lie, grown as their node's cell is."""
    from scenefold.render import occupied_kernels as kernels

    low, _, per_voxel = frame_of(tables)
    first, counts = arrays.group_first[pairs.groups], tables.groups.triangles[pairs.groups].astype(np.int64)
    held = arrays.vertices, arrays.triangles, first, counts
    kernels.mark_triangles(occupied, low, per_voxel, *held, pairs.matrices, pairs.dilations, np.empty((3, 3)))


def occupied_by(tables: SceneTables, arrays: SceneArrays, partition: Partition, me: int) -> U8:
    """The voxels in which the triangles lie that node `me` of a partition holds, all at once."""
    occupied = nothing_occupied()
    for pairs in pieces_of(tables, partition, me):
        mark(occupied, tables, arrays, pairs)
    return occupied


def _pairs(tables: SceneTables, instances: I64, groups: I64) -> Pairs:
    matrices = tables.instances.matrices[instances].astype(np.float64)
    farthest = np.maximum(np.abs(tables.groups.low[groups]), np.abs(tables.groups.high[groups])).astype(np.float64)
    terms = (np.abs(matrices[:, :, :3]) * farthest[:, None, :]).sum(axis=2) + np.abs(matrices[:, :, 3])
    return Pairs(groups, matrices, cell_margin(tables) + _LOST * terms.max(axis=1, initial=0.0))


def empty_space(tables: SceneTables, occupied: U8) -> EmptySpace:
    """What tracers skip by, where these voxels hold all of a scene's geometry."""
    from scenefold.partition.empty_walk_kernels import fill_reach

    reach = np.empty((SIDE, SIDE, SIDE), np.uint8)
    fill_reach(occupied, reach)
    return EmptySpace(reach, *frame_of(tables))


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
