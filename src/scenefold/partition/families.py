"""The kinds of cells, and what a partition must know of each (partitions.md, Cells).

A family is a number, used in documents and by compiled code, and three functions on its canonical f64
numbers: are they valid, how many are there for N nodes, and the table that kernels read. A new family is one
file like `voronoi.py`, one line in `RULES`, and its kernels (see `kernels.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.partition import boxes, power, slabs, voronoi, wedges

Floats = npt.NDArray[np.float64]


class Family(IntEnum):
    """How a partition's cells are shaped; the numbers stand in documents and never change."""

    VORONOI = 1
    WEDGES = 2
    SLABS = 3
    POWER = 4
    BOXES = 5


class FamilyRules(NamedTuple):
    """`size(nodes)` numbers; `fault(values, nodes)` names what is wrong or is ""; `kernel_data(values, nodes)`."""

    size: Callable[[int], int]
    fault: Callable[[Floats, int], str]
    kernel_data: Callable[[Floats, int], Floats]


RULES: dict[Family, FamilyRules] = {
    Family.VORONOI: FamilyRules(voronoi.size, voronoi.fault, voronoi.kernel_data),
    Family.WEDGES: FamilyRules(wedges.size, wedges.fault, wedges.kernel_data),
    Family.SLABS: FamilyRules(slabs.size, slabs.fault, slabs.kernel_data),
    Family.POWER: FamilyRules(power.size, power.fault, power.kernel_data),
    Family.BOXES: FamilyRules(boxes.size, boxes.fault, boxes.kernel_data),
}
