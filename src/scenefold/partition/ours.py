"""Our own rules: power cells and k-d boxes that share a sample of hits (specs/28-rebalancing.md, Ours)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.bounds import whole_weights
from scenefold.partition.boxes import Cut
from scenefold.partition.damping import damped
from scenefold.partition.families import Family
from scenefold.partition.kd_fit import Sample, fit_cuts
from scenefold.partition.placement import checked_box, van_der_corput
from scenefold.partition.power_fit import fit_weights
from scenefold.partition.rules import Measured
from scenefold.partition.start import halved
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]

_APART = 2.0**-12
"""Of the box's longest side: where centroids would coincide, they are spread in a box of this."""


def first_power(measured: Measured, nodes: int, *, epoch: int = 1) -> Partition:
    """Power cells around the means of a sample's halves of halves, or around a scattering of the box without one."""
    box, points = checked_box(measured.box), measured.hits
    shares = whole_weights(measured.hit_weights, len(points))
    spread = van_der_corput(box, nodes)
    centroids = np.array(halved(points, shares, nodes)) if len(points) >= nodes else spread
    side = float((box[1] - box[0]).max()) or 1.0
    if len(np.unique(centroids, axis=0)) < nodes:
        centroids = centroids + _APART * side * van_der_corput([[-1, -1, -1], [1, 1, 1]], nodes)
    return power(Partition.power(centroids, np.zeros(nodes), epoch=epoch), measured, 0.0).with_epoch(epoch)


def power(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Centroids stay, weights become those with which cells share the hits equally."""
    if partition.family != Family.POWER:
        raise LocalFault("this rule moves power cells", remedy="make a first partition of that kind")
    shares = whole_weights(measured.hit_weights, len(measured.hits)).astype(np.float64)
    table = partition.kernel_data()
    fitted = fit_weights(table[:, :3], table[:, 3], measured.hits, shares)
    if not _is_better(partition, Partition.power(table[:, :3], fitted), measured.hits, shares):
        return partition
    return partition.with_numbers(np.column_stack([table[:, :3], damped(table[:, 3], fitted, damping)]))


def first_kd(measured: Measured, nodes: int, *, epoch: int = 1) -> Partition:
    """Boxes of a k-d tree fitted to a sample and to geometry; without a sample, the scene's box halved and halved again."""
    return Partition.boxes(fit_cuts(_sample(measured), checked_box(measured.box), nodes), epoch=epoch)


def kd(partition: Partition, measured: Measured, damping: float) -> Partition:
    """Cuts fitted anew, from the root on; their axes stay where no other is much better."""
    if partition.family != Family.BOXES:
        raise LocalFault("this rule moves boxes of a k-d tree", remedy="make a first partition of that kind")
    sample, box = _sample(measured), checked_box(measured.box)
    if len(sample.points) == 0:
        return partition
    present = [Cut(int(axis), float(plane), int(lower)) for axis, plane, lower in partition.numbers.reshape(-1, 3)]
    fitted = Partition.boxes(fit_cuts(sample, box, partition.nodes, present))
    if not _is_better(partition, fitted, sample.points, sample.shares):
        return partition
    if damped(np.zeros(1), np.ones(1), damping)[0] < 1.0:
        fitted = Partition.boxes(fit_cuts(sample, box, partition.nodes, present, damping))
    return partition.with_numbers(fitted.numbers)


def _sample(measured: Measured) -> Sample:
    shares = whole_weights(measured.hit_weights, len(measured.hits)).astype(np.float64)
    return Sample(measured.hits, shares, measured.geometry)


def _is_better(before: Partition, after: Partition, points: Floats, shares: Floats) -> bool:
    """Whether the largest share of the points is smaller."""
    old, new = (np.bincount(cells.owner(points), shares, cells.nodes).max(initial=0.0) for cells in (before, after))
    return bool(new < old)
