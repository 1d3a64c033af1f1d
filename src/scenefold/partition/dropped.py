"""A partition without the cells of some nodes: those beside them carve them up (specs/06-cells.md, *Without some nodes*). Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition import boxes
from scenefold.partition.bounds import limit_spans
from scenefold.partition.families import Family
from scenefold.partition.value import Partition

Floats = npt.NDArray[np.float64]

_HEAD = {Family.WEDGES: 9, Family.SLABS: 6}
"""Numbers before the inner bounds."""


def without(partition: Partition, gone: Collection[int], epoch: int) -> Partition:
    """The cells of all nodes but these, whose indices close up, in another epoch. LocalFault if nobody is left, or they are no nodes of it."""
    left = [node for node in range(partition.nodes) if node not in gone]
    if not left or not all(0 <= node < partition.nodes for node in gone):
        raise LocalFault(f"a partition of {partition.nodes} nodes cannot be without {sorted(gone)}")
    numbers = partition.numbers
    match partition.family:
        case Family.VORONOI | Family.POWER:
            kept = numbers.reshape(partition.nodes, -1)[left].reshape(-1)
        case Family.WEDGES | Family.SLABS:
            head = _HEAD[partition.family]
            inner = _bounds_without(numbers[head:], left)
            kept = np.concatenate([numbers[:head], limit_spans(inner) if partition.family == Family.WEDGES else inner])
        case Family.BOXES:
            cuts = iter([boxes.Cut(int(axis), float(plane), int(lower)) for axis, plane, lower in numbers.reshape(-1, 3)])
            _, remaining = _tree_without(cuts, 0, partition.nodes, frozenset(left))
            kept = boxes.pack(remaining)
    return Partition(epoch, partition.family, len(left), (kept + 0.0).astype("<f8").tobytes())


def _bounds_without(inner: Floats, left: list[int]) -> Floats:
    """Between two neighbours that are left lies the middle of what lay between their cells."""
    return np.array([(inner[before] + inner[after - 1]) * 0.5 for before, after in pairwise(left)], np.float64)


def _tree_without(cuts: Iterator[boxes.Cut], first: int, nodes: int, left: frozenset[int]) -> tuple[int, list[boxes.Cut]]:
    """Of nodes first .. first + nodes - 1: how many are left, and the cuts between them. Where a side has none, the other takes it all."""
    if nodes == 1:
        return int(first in left), []
    cut = next(cuts)
    lower, lower_cuts = _tree_without(cuts, first, cut.lower, left)
    upper, upper_cuts = _tree_without(cuts, first + cut.lower, nodes - cut.lower, left)
    own = [boxes.Cut(cut.axis, cut.plane, lower)] if lower and upper else []
    return lower + upper, own + lower_cuts + upper_cuts
