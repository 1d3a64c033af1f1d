"""Owner, exit and overlap of cells, compiled, for every family (partitions.md, specs/06-cells.md).

Scalar functions, to be called from other kernels with `family: int32` and `data: float64[:, ::1]`, as
`Partition.family` and `Partition.kernel_data()` give them; and loops over arrays, for everybody else.
Points, directions and t are f64. Nothing here uses libm or fastmath or depends on how calls are batched.

A family is one file `<family>_kernels.py` with four functions, and one branch in each of the four dispatchers:

    owner(data, x, y, z, dx, dy, dz) -> node                            which cell; ties along d, then lowest node
    leave(data, node, ox, oy, oz, dx, dy, dz) -> (t, node)              last crossing out of the cell; may be < 0
    facets(data, node) -> count                                         half-spaces that hold the cell
    separates(data, node, facet, low.., high.., dilation) -> bool       the box lies beyond that one, dilated

numba's cache watches only the file of the outermost kernel: after an edit here, callers' caches must go.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from scenefold.partition import kd_kernels, power_kernels, slab_kernels, voronoi_kernels, wedge_kernels
from scenefold.partition.families import Family

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

_VORONOI = int(Family.VORONOI)
_WEDGES = int(Family.WEDGES)
_SLABS = int(Family.SLABS)
_POWER = int(Family.POWER)
_BOXES = int(Family.BOXES)

_voronoi_owner, _voronoi_leave = voronoi_kernels.owner, voronoi_kernels.leave
_voronoi_facets, _voronoi_separates = voronoi_kernels.facets, voronoi_kernels.separates
_wedge_owner, _wedge_leave = wedge_kernels.owner, wedge_kernels.leave
_wedge_facets, _wedge_separates = wedge_kernels.facets, wedge_kernels.separates
_slab_owner, _slab_leave = slab_kernels.owner, slab_kernels.leave
_slab_facets, _slab_separates = slab_kernels.facets, slab_kernels.separates
_power_owner, _power_leave = power_kernels.owner, power_kernels.leave
_power_facets, _power_separates = power_kernels.facets, power_kernels.separates
_box_owner, _box_leave = kd_kernels.owner, kd_kernels.leave
_box_facets, _box_separates = kd_kernels.facets, kd_kernels.separates

_CUTS = 4
"""An undecided box is cut into this many pieces a side: fewer boxes near edges of a cell are held for nothing."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner_ahead(family, data, x, y, z, dx, dy, dz):
    """Node into whose cell something at x, y, z flies that moves along d: int32.

    Differs from `owner_at` only for points on a hull. A camera ray starts on the axis of the wedges around
    the camera, in the hull of all of them, and is born in the cell it flies into.
    """
    if family == _VORONOI:
        return np.int32(_voronoi_owner(data, x, y, z, dx, dy, dz))
    if family == _WEDGES:
        return np.int32(_wedge_owner(data, x, y, z, dx, dy, dz))
    if family == _SLABS:
        return np.int32(_slab_owner(data, x, y, z, dx, dy, dz))
    if family == _POWER:
        return np.int32(_power_owner(data, x, y, z, dx, dy, dz))
    if family == _BOXES:
        return np.int32(_box_owner(data, x, y, z, dx, dy, dz))
    return np.int32(-1)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owner_at(family, data, x, y, z):
    """Node whose cell holds x, y, z, the lowest node on a hull: int32."""
    return owner_ahead(family, data, x, y, z, 0.0, 0.0, 0.0)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def leave_after(family, data, node, ox, oy, oz, dx, dy, dz, t):
    """Where after t the ray o + s d leaves the node's cell, and into whose: (f64, int32), or (inf, -1) if never.

    A ray that is outside already at t, and does not come back, leaves at t; the next node is then the owner
    of that point, except where rounding says that this is the node itself.
    """
    t_exit, target = math.inf, -1
    if family == _VORONOI:
        t_exit, target = _voronoi_leave(data, node, ox, oy, oz, dx, dy, dz)
    elif family == _WEDGES:
        t_exit, target = _wedge_leave(data, node, ox, oy, oz, dx, dy, dz)
    elif family == _SLABS:
        t_exit, target = _slab_leave(data, node, ox, oy, oz, dx, dy, dz)
    elif family == _POWER:
        t_exit, target = _power_leave(data, node, ox, oy, oz, dx, dy, dz)
    elif family == _BOXES:
        t_exit, target = _box_leave(data, node, ox, oy, oz, dx, dy, dz)
    if t_exit < t:
        t_exit = t
        here = owner_ahead(family, data, ox + t * dx, oy + t * dy, oz + t * dz, dx, dy, dz)
        if here != node:
            target = here
    return t_exit, np.int32(target)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def exit_after(family, data, node, ox, oy, oz, dx, dy, dz, t):
    """The smallest t_exit >= t from which on the ray o + s d is outside the node's cell: f64, inf if never."""
    t_exit = math.inf
    if family == _VORONOI:
        t_exit = _voronoi_leave(data, node, ox, oy, oz, dx, dy, dz)[0]
    elif family == _WEDGES:
        t_exit = _wedge_leave(data, node, ox, oy, oz, dx, dy, dz)[0]
    elif family == _SLABS:
        t_exit = _slab_leave(data, node, ox, oy, oz, dx, dy, dz)[0]
    elif family == _POWER:
        t_exit = _power_leave(data, node, ox, oy, oz, dx, dy, dz)[0]
    elif family == _BOXES:
        t_exit = _box_leave(data, node, ox, oy, oz, dx, dy, dz)[0]
    return max(t_exit, t)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _facets(family, data, node):
    if family == _VORONOI:
        return _voronoi_facets(data, node)
    if family == _WEDGES:
        return _wedge_facets(data, node)
    if family == _SLABS:
        return _slab_facets(data, node)
    if family == _POWER:
        return _power_facets(data, node)
    if family == _BOXES:
        return _box_facets(data, node)
    return 0


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _separates(family, data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
    if family == _VORONOI:
        return _voronoi_separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation)
    if family == _WEDGES:
        return _wedge_separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation)
    if family == _SLABS:
        return _slab_separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation)
    if family == _POWER:
        return _power_separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation)
    if family == _BOXES:
        return _box_separates(data, node, facet, lx, ly, lz, hx, hy, hz, dilation)
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _is_apart(family, data, node, lx, ly, lz, hx, hy, hz, dilation):
    """Whether one half-space alone shows that the box misses the dilated cell."""
    count = _facets(family, data, node)
    if count == 0:
        return False
    # Among Voronoi and power cells facet k faces node k, and that of the box's own owner is the likeliest to separate.
    middle = owner_at(family, data, 0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz))
    start = min(middle, count - 1)
    for step in range(count):
        facet = start + step
        if facet >= count:
            facet -= count
        if _separates(family, data, node, facet, lx, ly, lz, hx, hy, hz, dilation):
            return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _edge(low, high, cut):
    """The cut-th of the planes that cut low..high into `_CUTS` pieces; the outer ones exactly low and high."""
    if cut == 0:
        return low
    if cut == _CUTS:
        return high
    return min(max(low + (high - low) * (cut / _CUTS), low), high)


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def cell_meets_box(family, data, node, lx, ly, lz, hx, hy, hz, dilation):
    """False only if the box misses the node's cell grown by `dilation`; True may be wrong, close to an edge.

    The half-spaces of a cell, pushed out, hold the grown cell and somewhat more at its edges; and a box may
    miss the cell without lying beyond any single half-space. Cutting the box helps against the second.
    """
    if _is_apart(family, data, node, lx, ly, lz, hx, hy, hz, dilation):
        return False
    if owner_at(family, data, 0.5 * (lx + hx), 0.5 * (ly + hy), 0.5 * (lz + hz)) == node:
        return True
    for i in range(_CUTS):
        for j in range(_CUTS):
            for k in range(_CUTS):
                if not _is_apart(
                    family,
                    data,
                    node,
                    _edge(lx, hx, i),
                    _edge(ly, hy, j),
                    _edge(lz, hz, k),
                    _edge(lx, hx, i + 1),
                    _edge(ly, hy, j + 1),
                    _edge(lz, hz, k + 1),
                    dilation,
                ):
                    return True
    return False


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def owners(family: int, data: Floats, points: Floats, directions: Floats, found: Indices) -> None:
    """`owner_ahead` of n points: f64[n, 3] twice (or directions f64[0, 3] for `owner_at`) -> int32[n]."""
    still = directions.shape[0] == 0
    for i in range(points.shape[0]):
        if still:
            found[i] = owner_at(family, data, points[i, 0], points[i, 1], points[i, 2])
        else:
            found[i] = owner_ahead(
                family, data, points[i, 0], points[i, 1], points[i, 2], directions[i, 0], directions[i, 1], directions[i, 2]
            )


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def exits(
    family: int, data: Floats, origins: Floats, directions: Floats, t: Floats, nodes: Indices, t_exit: Floats, targets: Indices
) -> None:
    """`leave_after` of n rays: f64[n, 3] twice, f64[n], int32[n] -> f64[n], int32[n]."""
    for i in range(origins.shape[0]):
        t_exit[i], targets[i] = leave_after(
            family,
            data,
            nodes[i],
            origins[i, 0],
            origins[i, 1],
            origins[i, 2],
            directions[i, 0],
            directions[i, 1],
            directions[i, 2],
            t[i],
        )


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def overlaps(family: int, data: Floats, low: Floats, high: Floats, dilation: float, mask: npt.NDArray[np.bool_]) -> None:
    """`cell_meets_box` of N nodes and m boxes: f64[m, 3] twice -> bool[N, m]."""
    for i in range(low.shape[0]):
        for node in range(mask.shape[0]):
            mask[node, i] = cell_meets_box(
                family, data, node, low[i, 0], low[i, 1], low[i, 2], high[i, 0], high[i, 1], high[i, 2], dilation
            )
