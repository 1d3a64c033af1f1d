"""Which vertices of its accessors a primitive uses: files share one large array among thousands of small primitives.

They are found before anything of the arrays is read, so that a primitive costs what it uses and not what it names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]
_FEW = 8
"""Sorting so many times fewer corners than there are vertices is quicker than looking at all vertices."""


@dataclass(frozen=True, slots=True, eq=False)
class Vertices:
    """Some of the vertices that a primitive's accessors have."""

    count: int
    """How many each accessor has."""
    rows: Rows | None
    """Which of them, ascending; None: all."""

    def __len__(self) -> int:
        return self.count if self.rows is None else len(self.rows)

    def among(self, kept: NDArray[np.bool_]) -> Vertices:
        """Those of these that are `kept` (bool[len])."""
        return Vertices(self.count, np.flatnonzero(kept) if self.rows is None else self.rows[kept])


def used_by(triangles: NDArray[np.uint32], count: int) -> tuple[Vertices, NDArray[np.uint32]]:
    """The vertices, of so many, that triangles use, and the triangles with the numbers that they have among these."""
    if triangles.size < count // _FEW:
        found, numbers = np.unique(triangles.ravel(), return_inverse=True)
        return Vertices(count, found.astype(np.intp)), numbers.astype(np.uint32).reshape(-1, 3)
    used = np.zeros(count, bool)
    used[triangles.ravel()] = True
    if used.all():
        return Vertices(count, None), triangles
    number: NDArray[np.uint32] = np.cumsum(used, dtype=np.uint32) - np.uint32(1)
    return Vertices(count, np.flatnonzero(used)), number[triangles]
