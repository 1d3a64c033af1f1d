"""Where a job's scene is empty, put together from what each of its nodes holds (specs/32-empty-space.md). Pure.

A node marks the voxels that its triangles come near to. All of them together hold every triangle, so what none has marked
is empty, and stays so while the job lasts, whoever holds which cell.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.partition.leaps import SHIFT, Leaps
from scenefold.partition.occupancy import Grids, Occupancy, nothing_in
from scenefold.render.arrays import I64, JobNumbers
from scenefold.render.contract import HeldScene
from scenefold.render.numbers import diagonal_of

DILATION = 2.0**-11
"""Of the box's diagonal: by so much is grown what marks. Single precision moves the place of a hit by far less, but for a ray that all but lies in its triangle."""
PACKED_BYTES_MAX = 192 * 1024
_GRID_BYTES = 128**3 // 8
_LEVEL = 6


def marks_of(held: HeldScene, numbers: JobNumbers) -> Grids:
    """The voxels near to what a node holds: uint64[2, 128, 128, 2]."""
    from scenefold.render.empty_space_kernels import mark_pairs

    found, arrays = _nothing(numbers), held.arrays
    mark_pairs(
        found.grids,
        found.low,
        found.per_voxel,
        np.array(SHIFT),
        found.dilation,
        arrays.vertices,
        arrays.triangles,
        arrays.instance_matrices,
        _pairs(held),
    )
    return found.grids


def packed(grids: Grids) -> bytes:
    """For other nodes; the first grid alone where both would be too much, and nothing where that is, too."""
    for some in (grids, grids[:1]):
        payload = zlib.compress(some.astype("<u8").tobytes(), _LEVEL)
        if len(payload) <= PACKED_BYTES_MAX:
            return payload
    return b""


def unpacked(payload: object) -> Grids:
    """What `packed` gave, uint64[g, 128, 128, 2]: g is 0 where that was nothing. PeerFault for anything else."""
    if not isinstance(payload, bytes) or len(payload) > PACKED_BYTES_MAX:
        raise PeerFault("a map of empty space is ill-formed")
    if not payload:
        return np.empty((0, 128, 128, 2), np.uint64)
    stream = zlib.decompressobj()
    try:
        raw = stream.decompress(payload, 2 * _GRID_BYTES + 1)
    except zlib.error as error:
        raise PeerFault("a map of empty space is ill-formed") from error
    if len(raw) not in (_GRID_BYTES, 2 * _GRID_BYTES) or not stream.eof or stream.unused_data:
        raise PeerFault("a map of empty space is ill-formed")
    return np.frombuffer(raw, "<u8").reshape(-1, 128, 128, 2).astype(np.uint64)


def joined(payloads: Iterable[object]) -> bytes:
    """Of all nodes of a job, each as it was `packed`; nothing if one of them told nothing. PeerFault."""
    total: Grids | None = None
    for grids in map(unpacked, payloads):
        total = grids if total is None else total[: len(grids)] | grids[: len(total)]
    return b"" if total is None or not len(total) else packed(total)


def leaps_of(payload: object, numbers: JobNumbers) -> Leaps:
    """What a job's tracers need of it. PeerFault."""
    from scenefold.partition import leap_kernels

    grids, where = unpacked(payload), _nothing(numbers)
    return Leaps(leap_kernels.distances(grids), where.low, where.high, where.per_voxel, np.array(SHIFT))


def _nothing(numbers: JobNumbers) -> Occupancy:
    box: npt.NDArray[np.float64] = np.stack([numbers.box_low, numbers.box_high])
    return nothing_in(box, DILATION * diagonal_of(numbers.box_low, numbers.box_high))


def _pairs(held: HeldScene) -> I64:
    """int64[m, 3]: instance, first triangle, triangles."""
    rows = np.array([(one.prototype, held.arrays.group_first[one.group], one.triangles) for one in held.groups], np.int64).reshape(-1, 3)
    instances = np.array([(0, 0), *held.instances], np.int64).reshape(-1, 2)
    rows, instances = rows[np.argsort(rows[:, 0], kind="stable")], instances[np.argsort(instances[:, 1], kind="stable")]
    first, end = (np.searchsorted(rows[:, 0], instances[:, 1], side) for side in ("left", "right"))
    counts = end - first
    which = np.repeat(np.arange(len(instances)), counts)
    at = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + first[which]
    return np.ascontiguousarray(np.column_stack([instances[which, 0], rows[at, 1:]]))
