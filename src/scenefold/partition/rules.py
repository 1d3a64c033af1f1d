"""Rules by which cells move after a round: a partition and what was measured -> the next partition (specs/28-rebalancing.md).

Pure functions in global form: each knows all of what was measured. What nodes can do by themselves lies in
`free.py` and `local_bounds.py`. A rule returns the same value if nothing changes, else one of the next epoch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition import free
from scenefold.partition.bounds import checked_counts, equal_shares, fit_bounds, histogram, limit_spans
from scenefold.partition.circle import fit_circle, largest_on_circle, largest_on_line
from scenefold.partition.damping import checked, damped
from scenefold.partition.families import Family
from scenefold.partition.frame import turned_frame
from scenefold.partition.peers import peers, room
from scenefold.partition.placement import checked_box
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]

VOXELS = 16
"""A side, of the grid that Voxelised swarming tallies hits in."""


class Measured(NamedTuple):
    """What one round, or all so far, has shown. Unused parts may be empty: loads or hits, and geometry."""

    loads: Floats
    """f64[N], >= 0: rays handled, or estimated seconds until the queue is empty."""
    hits: Floats
    """f64[n, 3]: a sample of collisions."""
    hit_weights: Floats | None
    """f64[n] what each counts, say the time of its node for one; None: all alike."""
    box: Floats
    """f64[2, 3]: the scene's box."""
    geometry: Floats
    """f64[m, 2, 3]: boxes of what nodes hold, low corner and high corner."""


Rule = Callable[[Partition, Measured, float], Partition]
"""`rule(partition, measured, damping)`; LocalFault for a partition of another family than the rule's."""


def vivaldi(partition: Partition, measured: Measured, damping: float, *, threshold: float = 0.0) -> Partition:
    """Algorithm 1. A node rests while the deviation of its and its peers' loads is below `threshold` of their mean."""
    return _pulled(partition, measured, damping, threshold, certain=True)


def no_certainty(partition: Partition, measured: Measured, damping: float, *, threshold: float = 0.0) -> Partition:
    """Vivaldi whose peers pull by their loads alone."""
    return _pulled(partition, measured, damping, threshold, certain=False)


def swarming(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Algorithm 2: towards the mean of peers weighted by load, or away from it, within the cell; then damped."""
    return _swarmed(partition, measured, damping, back=True)


def no_backtracking(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Swarming in which nodes with more than their share stay."""
    return _swarmed(partition, measured, damping, back=False)


def voxelised_swarming(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Algorithm 4: nodes with more than their share retreat from where their hits are; others swarm."""
    centroids, near, corners, hosts = _seats(partition, measured)
    owners = partition.owner(measured.hits)
    meets = partition.overlaps(measured.geometry[:, 0], measured.geometry[:, 1], 0.0) if len(measured.geometry) else None
    moved = centroids.copy()
    for node, place in enumerate(centroids):
        loads = measured.loads[near[node]]
        load, mean = float(measured.loads[node]), float(np.append(loads, measured.loads[node]).mean())
        target = None
        if load > mean:
            hits = measured.hits[owners == node]
            held = measured.geometry[meets[node]].reshape(-1, 3) if meets is not None and meets[node].any() else hits
            target = _retreat(load, mean, held, hits)
        if target is None:
            target = free.swarm(place, load, centroids[near[node]], loads, back=True)
        moved[node] = free.within_cell(place, target, int(hosts[node]), centroids, corners)
    return partition.with_numbers(damped(centroids, moved, damping))


def planar(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Slabs of equal shares of the hits' depths, by the march through a histogram of the scene's depth."""
    _is(partition, Family.SLABS, "slabs")
    if partition.nodes == 1 or len(measured.hits) == 0:
        return partition
    numbers = partition.numbers
    axis, old = numbers[3:6], numbers[6:]
    corners = checked_box(measured.box)
    ends = np.where(axis > 0.0, corners, corners[::-1])
    near, far = ((ends - numbers[:3]) * axis).sum(axis=1)
    depth = float(far - near) or 1.0
    counts = histogram(((measured.hits - numbers[:3]) @ axis - near) / depth, measured.hit_weights)
    new = equal_shares(counts, partition.nodes)
    if largest_on_line(counts, new) >= largest_on_line(counts, np.clip((old - near) / depth, 0.0, 1.0)):
        return partition
    bounds = np.maximum.accumulate(damped(old, near + depth * new, damping))
    return partition.with_numbers(np.concatenate([numbers[:6], bounds]))


def bounded_radial(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Wedges of equal shares, bound 0 staying where it is. One or two nodes cannot move."""
    _is(partition, Family.WEDGES, "wedges")
    if partition.nodes <= 2 or len(measured.hits) == 0:
        return partition
    numbers, counts = partition.numbers, _around(partition, measured)
    new, old = fit_bounds(counts, partition.nodes), numbers[9:]
    if largest_on_line(counts, new) >= largest_on_line(counts, old):
        return partition
    return partition.with_numbers(np.concatenate([numbers[:9], limit_spans(damped(old, new, damping))]))


def radial(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Wedges of equal shares, all bounds moving; two nodes turn the plane between them."""
    _is(partition, Family.WEDGES, "wedges")
    if partition.nodes == 1 or len(measured.hits) == 0:
        return partition
    numbers, counts = partition.numbers, _around(partition, measured)
    old = numbers[9:]
    turn, new = fit_circle(counts, old)
    if largest_on_circle(counts, turn, new) >= largest_on_circle(counts, 0.0, old):
        return partition
    moved = (1.0 - checked(damping)) * turn
    frame = turned_frame(numbers[:9], moved)
    return partition.with_numbers(np.concatenate([frame, limit_spans(damped(old, turn + new, damping) - moved)]))


def _pulled(partition: Partition, measured: Measured, damping: float, threshold: float, *, certain: bool) -> Partition:
    centroids, near, corners, _ = _seats(partition, measured)
    loads, scale = measured.loads, float((measured.box[1] - measured.box[0]).max()) or float((corners[1] - corners[0]).max())
    doubts = np.array([free.doubt(loads[row]) for row in near])
    moved = centroids.copy()
    for node, row in enumerate(near):
        around = np.append(loads[row], loads[node])
        if not row.any() or free.doubt(around) < threshold * around.mean():
            continue
        weights = loads[row] * free.confidence(float(doubts[node]), doubts[row]) if certain else loads[row]
        moved[node] = free.vivaldi(centroids[node], centroids[row], weights, scale, damping)
    return partition.with_numbers(moved)


def _swarmed(partition: Partition, measured: Measured, damping: float, *, back: bool) -> Partition:
    centroids, near, corners, hosts = _seats(partition, measured)
    moved = centroids.copy()
    for node, row in enumerate(near):
        target = free.swarm(centroids[node], float(measured.loads[node]), centroids[row], measured.loads[row], back=back)
        moved[node] = free.within_cell(centroids[node], target, int(hosts[node]), centroids, corners)
    return partition.with_numbers(damped(centroids, moved, damping))


def _seats(partition: Partition, measured: Measured) -> tuple[Floats, npt.NDArray[np.bool_], Floats, npt.NDArray[np.int32]]:
    """Centroids, peers, the room, and the owner of each node's centroid."""
    _is(partition, Family.VORONOI, "Voronoi cells")
    loads = measured.loads
    if loads.shape != (partition.nodes,) or not (np.isfinite(loads) & (loads >= 0.0)).all():
        raise LocalFault("every node has a load, finite and not negative")
    box, centroids = checked_box(measured.box), partition.kernel_data()
    return centroids, peers(partition, box), room(box, centroids), partition.owner(centroids)


def _retreat(load: float, mean: float, held: Floats, hits: Floats) -> Floats | None:
    if len(held) == 0:
        return None
    low, high = held.min(axis=0), held.max(axis=0)
    sides = np.where(high > low, high - low, 1.0)
    inside = hits[((hits >= low) & (hits <= high)).all(axis=1)]
    voxels = np.clip((inside - low) / sides * VOXELS, 0, VOXELS - 1).astype(np.int64)
    tally = np.zeros((VOXELS, VOXELS, VOXELS), np.int64)
    np.add.at(tally, tuple(voxels.T), 1)
    return free.retreat(load, mean, low, high, tally)


def _around(partition: Partition, measured: Measured) -> Floats:
    """Hits by their angle from bound 0 on: f64[bins]."""
    numbers = partition.numbers
    away = measured.hits - numbers[:3]
    fractions = np.arctan2(away @ numbers[6:9], away @ numbers[3:6]) / (2.0 * np.pi) % 1.0
    return checked_counts(histogram(np.where(fractions < 1.0, fractions, 0.0), measured.hit_weights))


def _is(partition: Partition, family: Family, name: str) -> None:
    if partition.family != family:
        raise LocalFault(f"this rule moves {name}", remedy="make a first partition of that kind")
