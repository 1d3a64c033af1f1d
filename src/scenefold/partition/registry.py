"""Algorithms by name: the thesis's, ours, and those of installed packages (docs/how-to/write-a-partition-rule.md).

An algorithm is how its first cells are made and the rule by which they move. A package's own is named by an entry point of
the group `scenefold.partitions`; its cells are of one of the families, which are compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import metadata
from typing import NamedTuple

import numpy as np

from scenefold.base.errors import LocalFault
from scenefold.partition import ours, placement, rules
from scenefold.partition.bounds import even_bounds
from scenefold.partition.frame import Frame
from scenefold.partition.rules import Measured, Rule
from scenefold.partition.value import Partition

ENTRY_POINTS = "scenefold.partitions"


class Algorithm(NamedTuple):
    """What an entry point of the group names."""

    first: Callable[[Measured, int, Frame], Partition]
    """First cells for this many nodes, by a measured sample (which may be empty) and the camera's frame; epoch 1."""
    rule: Rule
    """The next cells, after a round."""


def _ring(measured: Measured, nodes: int, frame: Frame) -> Partition:
    return Partition.voronoi(placement.radial(measured.box, nodes, frame))


def _slices(measured: Measured, nodes: int, frame: Frame) -> Partition:
    depths = (placement.planar(measured.box, nodes, frame) - np.array(frame.origin)) @ np.array(frame.axis)
    return Partition.slabs(frame, np.maximum.accumulate(0.5 * (depths[1:] + depths[:-1])))


def _sectors(_measured: Measured, nodes: int, frame: Frame) -> Partition:
    return Partition.wedges(frame, even_bounds(nodes))


BUILT_IN: dict[str, Algorithm] = {
    "vivaldi": Algorithm(_ring, rules.vivaldi),
    "no-certainty": Algorithm(_ring, rules.no_certainty),
    "swarming": Algorithm(_ring, rules.swarming),
    "no-backtracking": Algorithm(_ring, rules.no_backtracking),
    "voxelised-swarming": Algorithm(_ring, rules.voxelised_swarming),
    "planar": Algorithm(_slices, rules.planar),
    "radial": Algorithm(_sectors, rules.radial),
    "bounded-radial": Algorithm(_sectors, rules.bounded_radial),
    "power": Algorithm(lambda measured, nodes, _frame: ours.first_power(measured, nodes), ours.power),
    "kd": Algorithm(lambda measured, nodes, _frame: ours.first_kd(measured, nodes), ours.kd),
}


def load_algorithm(name: str) -> Algorithm:
    """The built-in or installed algorithm of this name; LocalFault if there is none, or if it is no Algorithm."""
    if name in BUILT_IN:
        return BUILT_IN[name]
    for entry in metadata.entry_points(group=ENTRY_POINTS, name=name):
        found = entry.load()
        if not isinstance(found, Algorithm):
            raise LocalFault(f"the entry point {name!r} names no Algorithm", where=ENTRY_POINTS, remedy="update the package that it is of")
        return found
    known = sorted({*BUILT_IN, *(entry.name for entry in metadata.entry_points(group=ENTRY_POINTS))})
    raise LocalFault(f"no partition algorithm is called {name!r}", remedy=f"install it, or choose one of: {', '.join(known)}")
