"""What one node adds up for one open pass: integers per path, in any order the same bits (rendering.md, Passes)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenefold.render.arrays import I32, I64

AOV_COLUMNS = 8
COUNTERS = 3


@dataclass(frozen=True, slots=True)
class PassSums:
    """Sums of one pass on one node; `advance` adds to them in place."""

    radiance: I64
    """int64[paths, 3], units of 2^-32."""
    aovs: I32
    """int32[paths, 8]: albedo, normal, depth, hit; written by the node that found the first hit."""
    counters: I64
    """int64[3]: shadow rays cast, contributions that were not finite, contributions clamped."""

    @classmethod
    def zeros(cls, paths: int) -> PassSums:
        """For a pass of this many paths."""
        return cls(
            np.zeros((paths, 3), np.int64), np.zeros((paths, AOV_COLUMNS), np.int32), np.zeros(COUNTERS, np.int64)
        )
