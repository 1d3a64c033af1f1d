"""In which order the camera rays of a pass are made: those of neighbouring pixels one after the other.

A pass is scattered over the image (pixel_kernels.py), so that every pass sees all of it and all nodes have work. Within
the pass the order is free, for no bit of the image depends on it. Rays of neighbouring pixels meet the same nodes of
Embree's trees, triangles and texels, and so do their bounces, which follow them; these then lie in the caches.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from scenefold.render.arrays import U32, JobNumbers
from scenefold.render.lanes_kernels import LANES

_SIDE_BITS = 7
_TILES = 1 << (2 * _SIDE_BITS)


class PathOrder:
    """Orders passes of one job. Not thread safe."""

    def __init__(self, job: JobNumbers) -> None:
        self._job = job
        self._columns, self._rows = _tile_bits(job.crop_width), _tile_bits(job.crop_height) << np.uint32(1)
        self._starts = np.empty(_TILES + 1, np.uint32)

    def of_pass(self, first_path: int, count: int) -> U32:
        """uint32[count, and up to a whole number of `LANES`, of zeros]: the paths 0 .. count - 1 of a pass, in order.

        first_path: global number of the pass's path 0; count: at most 65,536.
        """
        order = np.zeros(-(-count // LANES) * LANES, np.uint32)
        _order_by_tile(self._job, np.int64(first_path), self._columns, self._rows, self._starts, np.empty(count, np.uint32), order)
        return order


def _tile_bits(side: int) -> U32:
    """uint32[side]: for each pixel along a side, in which of 128 tiles it lies, the bits of that spread to every second place."""
    tiles = (np.arange(side, dtype=np.uint64) << np.uint64(_SIDE_BITS)) // np.uint64(side)
    bits = np.zeros(side, np.uint32)
    for bit in range(_SIDE_BITS):
        bits |= (((tiles >> np.uint64(bit)) & np.uint64(1)) << np.uint64(2 * bit)).astype(np.uint32)
    return bits


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _order_by_tile(job, first_path, columns, rows, starts, tiles, order):  # type: ignore[no-untyped-def]
    """Stable counting sort of a pass's paths by the tile of their pixel, tiles along Morton's curve.

    columns uint32[crop_width] and rows uint32[crop_height]: a tile's number is the sum of both; starts uint32[_TILES + 1] and
    tiles uint32[paths] to work in; order uint32[>= paths] is written.
    """
    pixels, width = job.crop_width * job.crop_height, np.uint32(job.crop_width)
    # What each path's pixel is, without a multiplication: the next one lies a stride on.
    at, step = first_path % pixels * job.stride % pixels, job.stride % pixels
    starts[:] = np.uint32(0)
    for path in range(tiles.shape[0]):
        row = np.uint32(at) // width
        tile = columns[np.uint32(at) - row * width] + rows[row]
        tiles[path] = tile
        starts[tile + np.uint32(1)] += np.uint32(1)
        at += step
        if at >= pixels:
            at -= pixels
    for tile in range(_TILES):
        starts[tile + 1] += starts[tile]
    for path in range(tiles.shape[0]):
        order[starts[tiles[path]]] = np.uint32(path)
        starts[tiles[path]] += np.uint32(1)
