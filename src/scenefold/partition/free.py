"""Free algorithms: a node moves by what it hears of its peers (Algorithms 1, 2, 4; specs/28-rebalancing.md, Free).

Each function here is one node's own step, from its position and its peers' alone: the local form. The global form
is that all nodes step at once (`rules.py`). Positions are f64[3] and f64[m, 3], loads numbers >= 0 of one unit.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.partition.damping import damped

Floats = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]


def doubt(loads: Floats) -> float:
    """Standard deviation of these peers' loads, n - 1 in its divisor; 0 of fewer than two. Certainty is its inverse."""
    return float(loads.std(ddof=1)) if len(loads) > 1 else 0.0


def confidence(own: float, others: Floats) -> Floats:
    """Each peer's certainty as a share of its and ours, from doubts: f64[m], a half where both are certain."""
    total = own + others
    shares: Floats = np.divide(own, total, out=np.full(len(others), 0.5), where=total > 0.0)
    return shares


def pull(position: Floats, peers: Floats, weights: Floats) -> Floats:
    """Sum of the unit vectors to each peer, by weights that are made to sum to 1: f64[3]; 0 if all weights are."""
    ways = peers - position
    lengths = np.sqrt((ways * ways).sum(axis=1, keepdims=True))
    units = np.divide(ways, lengths, out=np.zeros_like(ways), where=lengths > 0.0)
    total = float(weights.sum())
    return np.asarray(weights @ units / total if total > 0.0 else np.zeros(3), np.float64)


def within_hull(position: Floats, target: Floats, peers: Floats) -> Floats:
    """The point nearest to target on the way to it that lies in the hull of the peers and the position itself."""
    from scenefold.partition.hull_kernels import reach

    stop: Floats = position + reach(np.ascontiguousarray(peers - position), target - position) * (target - position)
    return stop


def vivaldi(position: Floats, peers: Floats, weights: Floats, scale: float, damping: float) -> Floats:
    """Algorithm 1, lines 7 to 14: pulled by the peers, `scale` at most; damped; then kept in their hull.

    `weights` are loads times `confidence`, or loads alone (No certainty).
    """
    target = damped(position, position + scale * pull(position, peers, weights), damping)
    return within_hull(position, target, peers)


def swarm(position: Floats, load: float, peers: Floats, loads: Floats, *, back: bool) -> Floats:
    """Algorithm 2, lines 1 to 4: towards (and if `back` also from) the mean of all, weighted by loads. Not damped."""
    every = np.append(loads, load)
    mean = float(every.mean())
    if mean == 0.0:
        return position
    middle = every @ np.vstack([peers, position]) / every.sum()
    share = (mean - load) / mean
    moved: Floats = position + (share if back else max(0.0, share)) * (middle - position)
    return moved


def retreat(load: float, mean: float, low: Floats, high: Floats, tally: Counts) -> Floats | None:
    """Algorithm 4, lines 10 to 17, for a load above the mean: where to move to, or None without any voxel.

    `tally` is int64[k, k, k], hits in each voxel of the box low .. high of the node's geometry. From the mean of
    the voxels with hits, weighted by 1 / tally, towards that of those without, by how much of the load is too much.
    """
    steps = [low[i] + (high[i] - low[i]) * (np.arange(tally.shape[i]) + 0.5) / tally.shape[i] for i in range(3)]
    centres = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    hits = tally.reshape(-1)
    hit, free = hits > 0, hits == 0
    if not hit.any():
        return None
    weights = 1.0 / hits[hit]
    lightly: Floats = weights @ centres[hit] / weights.sum()
    if not free.any():
        return lightly
    away: Floats = lightly + (1.0 - mean / load) * (centres[free].mean(axis=0) - lightly)
    return away


def within_cell(position: Floats, target: Floats, host: int, centroids: Floats, corners: Floats) -> Floats:
    """The farthest point on the way to target that lies in Voronoi cell `host` and in the box f64[2, 3].

    `position` lies in both. A node whose own cell is empty gives the node that owns its position as host.
    """
    way = target - position
    across = centroids - centroids[host]
    nearing = across @ way
    gaps = ((0.5 * (centroids + centroids[host]) - position) * across).sum(axis=1)
    stops = np.divide(gaps, nearing, out=np.full(len(centroids), np.inf), where=nearing > 0.0)
    ahead = np.where(way > 0.0, corners[1] - position, corners[0] - position)
    walls = np.divide(ahead, way, out=np.full(3, np.inf), where=way != 0.0)
    share = min(1.0, max(0.0, float(stops.min())), max(0.0, float(walls.min())))
    return position + share * way
