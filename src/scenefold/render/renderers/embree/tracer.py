"""One node's tracer for one job: rays in, contributions and leaving rays out (thesis figure B.2).

`advance` works a batch off until nothing of it is left in this node's cell. It keeps a stack of rays and takes
a chunk from its top at a time, so that memory stays bounded whatever a path does, and the youngest rays, whose
surroundings are warm in the caches, go first. It is called in a worker thread; the kernels release the GIL.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from scenefold.base.rays import RAY_WORDS
from scenefold.partition import Partition
from scenefold.render.arrays import F32, I64, NOTHING_KNOWN, U8, U32, EmptySpace, JobNumbers, SceneArrays
from scenefold.render.contract import Advanced
from scenefold.render.generate_kernels import SCRATCH_WORDS, generate_pass
from scenefold.render.order_kernels import PathOrder
from scenefold.render.pass_sums import PassSums
from scenefold.render.renderers.embree import cast_kernels, filter_kernels, library
from scenefold.render.renderers.embree.geometry import HeldGeometry
from scenefold.render.route_kernels import group_by_owner, split_by_owner, take_forwarded
from scenefold.render.shade_kernels import STATUS_HIT, shade_batch

CHUNK_RAYS = 8192
HITS_PER_TOLD = 64
"""One hit of so many is told, for cells that follow the work."""
"""Rays cast and shaded at a time: their records and hits fit a core's second-level cache."""


class EmbreeTracer:
    """Traces rays within one cell of one partition. Not thread safe: one tracer a worker thread."""

    def __init__(self, arrays: SceneArrays, geometry: HeldGeometry, job: JobNumbers, partition: Partition, me: int) -> None:
        self._arrays = arrays
        self._geometry = geometry
        self._job = job
        self._order = PathOrder(job)
        self._family = np.int32(partition.family)
        self._cells = partition.kernel_data()
        self._nodes = partition.nodes
        self._me = np.int32(me)
        self._empty = NOTHING_KNOWN
        self._intersect = np.int64(library.function_address("rtcIntersect1"))
        self._occluded = np.int64(library.function_address("rtcOccluded1"))
        self._filters = np.array([one.address for one in filter_kernels.FILTERS], np.int64)
        self._see_through = np.int64(geometry.has_see_through)
        self._addresses = _addresses_of(arrays)
        self._workspace = _aligned_words(filter_kernels.WORKSPACE_WORDS)
        self._status = np.empty(CHUNK_RAYS, np.uint8)
        self._hit_uv = np.empty((CHUNK_RAYS, 2), np.float32)
        self._hit_ids = np.empty((CHUNK_RAYS, 3), np.uint32)
        self._ways = np.empty((CHUNK_RAYS, 3), np.float32)
        self._reached = np.empty(CHUNK_RAYS, np.float32)
        self._listed = np.empty(2 * CHUNK_RAYS, np.int64)
        self._scratch = _aligned_words(SCRATCH_WORDS)
        self._out = np.empty((3 * CHUNK_RAYS, RAY_WORDS), np.uint32)
        self._owners = np.empty(3 * CHUNK_RAYS, np.int32)
        self._stack = np.empty((8 * CHUNK_RAYS, RAY_WORDS), np.uint32)
        self._leaving = np.empty((4 * CHUNK_RAYS, RAY_WORDS), np.uint32)
        self._leaving_owner = np.empty(4 * CHUNK_RAYS, np.int32)
        self._untold = 0
        """Hits since the last one that was told."""

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        """See `Tracer`. What misses the job's box altogether stays here, to see the sky."""
        rays = np.empty((count, RAY_WORDS), np.uint32)
        generate_pass(self._job, np.int64(first_path), self._order.of_pass(first_path, count), rays, self._scratch)
        owners = np.empty(len(rays), np.int32)
        self._find_owners(rays, owners)
        return self._grouped(rays, owners, len(rays))

    def route(self, rays: U32) -> dict[int, U32]:
        """See `RoutingTracer`. Any thread may call it, whatever this tracer does meanwhile."""
        owners = np.empty(len(rays), np.int32)
        # They are not this tracer's alone, and what they are done up to is written into them.
        rays = np.array(rays, np.uint32, order="C")
        self._write_owners(rays, owners, _aligned_words(SCRATCH_WORDS))
        return self._grouped(rays, owners, len(rays))

    def skip(self, empty: EmptySpace) -> None:
        """See `SkippingTracer`."""
        self._empty = empty

    def advance(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        """Trace uint32[n, 9] of one pass until each ray ended or left this cell; `sums` is added to."""
        if self._nodes == 1:
            return self._finish(rays, first_path, sums)
        top = len(rays)
        # The buffers stay with the tracer: fresh megabytes for each small batch cost more than its rays.
        stack = _with_room(self._stack, 0, top + 4 * CHUNK_RAYS)
        stack[:top] = rays
        leaving, leaving_owner = self._leaving, self._leaving_owner
        left = created = retired = casts = hit_count = 0
        told: list[F32] = []
        shadow_before = int(sums.counters[0])
        while top > 0:
            count = min(CHUNK_RAYS, top)
            top -= count
            batch = stack[top : top + count].copy()
            made, kept = self._step(batch, first_path, sums)
            hit_count += self._tell(batch, told)
            casts += count
            created += made
            retired += count - (kept - made)
            stack = _with_room(stack, top, kept)
            if left + kept > len(leaving):
                leaving, leaving_owner = _with_room(leaving, left, kept), _with_room(leaving_owner, left, kept)
            top, left = split_by_owner(self._out[:kept], self._owners, self._me, stack, top, leaving, leaving_owner, left)
        shadow_casts = int(sums.counters[0]) - shadow_before
        self._stack, self._leaving, self._leaving_owner = stack, leaving, leaving_owner
        hits = np.concatenate(told) if told else np.empty((0, 3), np.float32)
        return Advanced(self._grouped(leaving, leaving_owner, left), created, retired, casts, shadow_casts, hits, hit_count)

    def _tell(self, batch: U32, told: list[F32]) -> int:
        """Add every so many-th hit of a chunk that was cast to `told`; how many hits it has."""
        rows = np.flatnonzero(self._status[: len(batch)] == STATUS_HIT)
        chosen = rows[HITS_PER_TOLD - 1 - self._untold :: HITS_PER_TOLD]
        self._untold = (self._untold + len(rows)) % HITS_PER_TOLD
        if len(chosen):
            told.append(batch[chosen, :3].view(np.float32) + self._ways[chosen] * self._reached[chosen, None])
        return len(rows)

    def _finish(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        """Where there is one cell only, no ray leaves and none is cast twice."""
        top, created = len(rays), 0
        stack = _with_room(self._stack, 0, top + 4 * CHUNK_RAYS)
        stack[:top] = rays
        shadow_before = int(sums.counters[0])
        while top > 0:
            count = min(CHUNK_RAYS, top)
            batch = stack[top - count : top]
            status = self._status[:count]
            self._cast(batch, first_path, status)
            made = self._shade(batch, first_path, status, sums)
            top -= count
            stack = _with_room(stack, top, made)
            stack[top : top + made] = self._out[:made]
            top += made
            created += made
        self._stack = stack
        casts = len(rays) + created
        return Advanced({}, created, casts, casts, int(sums.counters[0]) - shadow_before)

    def _step(self, batch: U32, first_path: int, sums: PassSums) -> tuple[int, int]:
        """Cast and shade a chunk; returns (new rays, new and forwarded rays) now in `_out`, owners in `_owners`."""
        status = self._status[: len(batch)]
        self._cast(batch, first_path, status)
        made = self._shade(batch, first_path, status, sums)
        kept = take_forwarded(batch, status, self._out, made)
        self._find_owners(self._out[:kept], self._owners)
        return made, int(kept)

    def _cast(self, batch: U32, first_path: int, status: U8) -> None:
        cast_kernels.cast_batch(
            self._intersect,
            self._occluded,
            self._filters,
            self._addresses,
            self._see_through,
            np.int64(self._geometry.scene_address),
            np.uint32(self._geometry.first_instance_id),
            self._workspace,
            self._scratch,
            batch,
            np.int64(self._nodes == 1),
            self._family,
            self._cells,
            self._me,
            self._job,
            np.int64(first_path),
            status,
            self._hit_uv,
            self._hit_ids,
            self._ways,
            self._reached,
            self._listed,
        )

    def _shade(self, batch: U32, first_path: int, status: U8, sums: PassSums) -> int:
        made = shade_batch(
            batch,
            status,
            self._hit_uv,
            self._hit_ids,
            self._arrays,
            self._job,
            np.int64(first_path),
            sums.radiance,
            sums.aovs,
            sums.counters,
            self._listed,
            self._scratch,
            self._out,
        )
        return int(made)

    def _find_owners(self, rays: U32, owners: npt.NDArray[np.int32]) -> None:
        if self._nodes == 1:
            owners[: len(rays)] = self._me
            return
        self._write_owners(rays, owners, self._scratch)

    def _write_owners(self, rays: U32, owners: npt.NDArray[np.int32], scratch: U32) -> None:
        job = self._job
        cast_kernels.find_owners(rays, self._family, self._cells, self._empty, job.box_low, job.box_high, self._me, owners, scratch)

    def _grouped(self, rays: U32, owners: npt.NDArray[np.int32], count: int) -> dict[int, U32]:
        first: I64 = np.empty(self._nodes + 1, np.int64)
        grouped = np.empty((count, RAY_WORDS), np.uint32)
        group_by_owner(rays, owners, count, first, grouped)
        return {node: grouped[first[node] : first[node + 1]] for node in range(self._nodes) if first[node] < first[node + 1]}


def _addresses_of(arrays: SceneArrays) -> I64:
    """Where the caster's filters find the arrays of a scene, which must outlive the tracer."""
    places = [getattr(arrays, name).ctypes.data for name in filter_kernels.TABLE]
    addresses: I64 = np.array([*places, arrays.has_uvs2, arrays.has_colors], np.int64)
    assert len(addresses) == filter_kernels.TABLE_WORDS
    return addresses


def _aligned_words(count: int) -> U32:
    """uint32[count] at an address that Embree's aligned loads accept (64 bytes)."""
    raw = np.zeros(count + 16, np.uint32)
    skip = (-raw.ctypes.data % 64) // 4
    return raw[skip : skip + count]


_Scalar = TypeVar("_Scalar", bound=np.generic)


def _with_room(array: npt.NDArray[_Scalar], used: int, more: int) -> npt.NDArray[_Scalar]:
    """The array, or a longer copy of its used part, with room for `more` rows behind `used`."""
    if used + more <= len(array):
        return array
    longer = np.empty((2 * (used + more), *array.shape[1:]), array.dtype)
    longer[:used] = array[:used]
    return longer
