"""Peers: nodes whose cells are next to each other (partitions.md, Cells; specs/28-rebalancing.md, Peers)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.families import Family
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def room(box: npt.ArrayLike, centroids: Floats) -> Floats:
    """f64[2, 3]: the box of the scene and of all centroids, within which peers meet and centroids move."""
    corners = np.asarray(box, np.float64)
    return np.array([np.minimum(corners[0], centroids.min(axis=0)), np.maximum(corners[1], centroids.max(axis=0))])


def peers(partition: Partition, box: npt.ArrayLike) -> Mask:
    """Which nodes are whose peers, in a cube twice as long as the room: bool[N, N], symmetric but for empty cells.

    For Voronoi and power cells; LocalFault for others. A node with an empty cell has the peers of the node that
    owns its centroid, and that node: it can move out again, and nobody else sees it.
    """
    from scenefold.partition import peer_kernels

    if partition.family not in (Family.VORONOI, Family.POWER):
        raise LocalFault("only cells of centroids have peers by facets: Voronoi and power cells")
    table = partition.kernel_data()
    centroids = table[:, :3]
    low, high = room(box, centroids)
    side = float((high - low).max()) or 1.0
    weights = table[:, 3] if partition.family == Family.POWER else np.zeros(partition.nodes)
    areas = peer_kernels.facet_areas(np.column_stack([centroids - 0.5 * (low + high), weights]), side)
    near: Mask = areas > peer_kernels.SLIVER * side * side
    hosts = partition.owner(centroids)
    for node in np.flatnonzero(~near.any(axis=1) & (hosts != np.arange(partition.nodes))):
        near[node] = near[hosts[node]]
        near[node, hosts[node]] = True
    return near
