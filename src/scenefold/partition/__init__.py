"""Cells: convex parts of space, each answered for by one node (partitions.md, specs/06-cells.md).

`Partition` is the value that is sent around, `make_partition` makes a job's first. Kernels of other rooms call
the scalar functions of `scenefold.partition.kernels`, which is the only part that imports numba at once.
"""

from scenefold.partition.bounds import even_bounds, fit_bounds, histogram, limit_spans
from scenefold.partition.families import Family
from scenefold.partition.frame import Frame, camera_frame
from scenefold.partition.start import make_partition
from scenefold.partition.value import Partition

__all__ = [
    "Family",
    "Frame",
    "Partition",
    "camera_frame",
    "even_bounds",
    "fit_bounds",
    "histogram",
    "limit_spans",
    "make_partition",
]
