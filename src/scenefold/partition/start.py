"""The first partition of a job: made once, by the owner of the job's location, and sent to all as a value.

The sample is what is known before any ray flew: where geometry lies, weighted by how much. For wedges the
global fit does the rest. Voronoi cells start as a ring around the camera (the best start for free algorithms in
the thesis, 4.4.1) or from halving the sample again and again, whichever balances it better after lighter nodes
have moved towards heavier ones for a while. (Tried: an even ring, a low-discrepancy cloud; both end far worse.)
What follows once work is measured is for the update rules, not for this module.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition.bounds import even_bounds, fit_bounds, histogram, whole_weights
from scenefold.partition.frame import Frame, camera_frame
from scenefold.partition.placement import checked_box, radial
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]
Algorithm = Literal["bounded-radial", "voronoi"]

EVEN_SHARE = 0.25
"""Of the work, presumed to lie evenly around the camera axis whatever the geometry: camera rays and their first hits."""
_SAMPLES_MAX = 8192
"""Points that Voronoi cells are balanced on: a hundred per node at the least."""
_PULLS = 48
_STEP = 0.5


def make_partition(
    algorithm: Algorithm,
    node_count: int,
    box: npt.ArrayLike,
    camera_position: npt.ArrayLike,
    camera_forward: npt.ArrayLike,
    camera_up: npt.ArrayLike,
    sample_points: npt.ArrayLike | None = None,
    weights: npt.ArrayLike | None = None,
    *,
    even_share: float = EVEN_SHARE,
    epoch: int = 1,
) -> Partition:
    """Start cells that share the sample well.

    `box` is f64[2, 3]; `sample_points` f64[n, 3] with `weights` f64[n] (default: all alike), say group centres
    and triangle counts. Without a sample, wedges are equal and centroids stand evenly around the camera axis.
    `even_share`, 0 to 1, counts for wedges only.
    """
    if not 1 <= node_count <= POOL_NODES_MAX:
        raise LocalFault(f"cells are for 1 to {POOL_NODES_MAX} nodes, not {node_count}")
    frame = camera_frame(camera_position, camera_forward, camera_up)
    corners = checked_box(box)
    points = np.zeros((0, 3)) if sample_points is None else np.asarray(sample_points, np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise LocalFault("a sample point is not finite")
    shares = whole_weights(weights, len(points))
    match algorithm:
        case "bounded-radial":
            return Partition.wedges(frame, _bounds(frame, node_count, points, shares, even_share), epoch=epoch)
        case "voronoi":
            return Partition.voronoi(_centroids(frame, node_count, corners, points, shares), epoch=epoch)
    raise LocalFault(f"no partition algorithm is called {algorithm!r}", remedy="use bounded-radial or voronoi")


def _bounds(frame: Frame, nodes: int, points: Floats, shares: Counts, even_share: float) -> Floats:
    if not 0.0 <= even_share <= 1.0:
        raise LocalFault(f"the even share of work lies between 0 and 1, not at {even_share}")
    if shares.sum() == 0:
        return even_bounds(nodes)
    counts = histogram(frame.fractions(points), shares)
    return fit_bounds((1.0 - even_share) * counts / counts.sum() + even_share / len(counts), nodes)


def _centroids(frame: Frame, nodes: int, box: Floats, points: Floats, shares: Counts) -> Floats:
    """The best-balanced of several starts; the first of them where equal."""
    ring = radial(box, nodes, frame)
    if nodes == 1 or shares.sum() == 0:
        return ring
    points, shares = _thinned(points, shares)
    starts = [radial(box, nodes, frame, fit_bounds(histogram(frame.fractions(points), shares), nodes))]
    if len(points) >= nodes:
        starts.append(np.array(halved(points, shares, nodes)))
    balanced = [_pulled(start, box, points, shares) for start in starts]
    return min(balanced, key=lambda pair: pair[0])[1]


def halved(points: Floats, shares: Counts, nodes: int) -> list[Floats]:
    """Means of the parts of the sample that come from cutting it across its longest side, for as many nodes.

    At least as many points as nodes; `shares` int64[n].
    """
    if nodes == 1:
        return [points.mean(axis=0)]
    side = int(np.argmax(points.max(axis=0) - points.min(axis=0)))
    order = np.argsort(points[:, side], kind="stable")
    fewer = nodes // 2
    running = np.cumsum(shares[order])
    cut = int(np.searchsorted(running * nodes, running[-1] * fewer)) + 1
    cut = min(max(cut, fewer), len(order) - (nodes - fewer))
    lower, upper = order[:cut], order[cut:]
    return halved(points[lower], shares[lower], fewer) + halved(points[upper], shares[upper], nodes - fewer)


def _pulled(centroids: Floats, box: Floats, points: Floats, shares: Counts) -> tuple[int, Floats]:
    """The largest load and the centroids, after the best of some rounds.

    In a round, nodes move towards near nodes that have more to do; the hull between two nodes moves half as far
    as either, so the lighter one's cell grows into the heavier one's.
    """
    best_load, loads = _loads(centroids, points, shares)
    best, mean = centroids, shares.sum() / len(centroids)
    low, high = _room(box, centroids)
    for _ in range(_PULLS):
        centroids = np.clip(centroids + _STEP * _moves(centroids, loads / mean), low, high)
        load, loads = _loads(centroids, points, shares)
        if load < best_load:
            best_load, best = load, centroids
    return best_load, best


def _moves(centroids: Floats, loads: Floats) -> Floats:
    """Each node's full step: towards heavier nodes, by the excess, near ones most, and never past one."""
    ways = centroids[None, :, :] - centroids[:, None, :]
    squares = np.einsum("ijk,ijk->ij", ways, ways)
    np.fill_diagonal(squares, np.inf)
    nearest = squares.min(axis=1, keepdims=True)
    nearness = np.where(squares > 0.0, nearest / np.maximum(squares, 1e-300), 0.0) ** 2
    excess = np.clip(loads[None, :] - loads[:, None], 0.0, 4.0) / 4.0 * nearness
    total = np.maximum(excess.sum(axis=1, keepdims=True), 1.0)
    steps: Floats = np.einsum("ij,ijk->ik", excess / total, ways)
    return steps


def _room(box: Floats, centroids: Floats) -> tuple[Floats, Floats]:
    """Where centroids may be: the box, and wherever they started outside it."""
    return np.minimum(box[0], centroids.min(axis=0)), np.maximum(box[1], centroids.max(axis=0))


def _loads(centroids: Floats, points: Floats, shares: Counts) -> tuple[int, Counts]:
    loads = np.zeros(len(centroids), np.int64)
    np.add.at(loads, Partition.voronoi(centroids).owner(points), shares)
    return int(loads.max()), loads


def _thinned(points: Floats, shares: Counts) -> tuple[Floats, Counts]:
    """At most `_SAMPLES_MAX` of the points, evenly from their list in order of place: any order of arrival will do."""
    order = np.lexsort((shares, points[:, 2], points[:, 1], points[:, 0]))
    stride = -(-len(order) // _SAMPLES_MAX)
    kept = order[::stride]
    return points[kept], shares[kept]
