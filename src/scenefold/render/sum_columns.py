"""Columns of a pass's sums: what renderers write and films read (specs/08-passes.md, *Sums of a pass on a node*). Constants, for kernels too.

    radiance  int64[paths, 3]   in units of 1 / RADIANCE_UNIT: red, green, blue of all light
              int64[paths, 9]   the same in three parts, whose sum is all light: EMISSION, DIRECT, INDIRECT
    aovs      int32[paths, 8]   of the first hit, in units of 1 / AOV_UNIT: ALBEDO 3, NORMAL 3, DEPTH; and HIT, 1
              int32[paths, 13]  and POSITION 3 in the same units; OBJECT and MATERIAL, plain numbers

How many columns there are is the job's to say; kernels see it by the arrays' shapes.
"""

from __future__ import annotations

from dataclasses import dataclass

RADIANCE_UNIT = 4294967296.0
AOV_UNIT = 16777216.0
SQUARE_UNIT = 4294967296.0
"""Of the squares that a film adds up: those of a radiance of 1e-4 are still told apart."""

CHANNELS = 3
"""Red, green, blue."""

EMISSION = 0
"""Light of what the camera itself sees: a path ray of bounce 0 that finds a light or the sky."""
DIRECT = 3
"""Light that was reflected once: a shadow ray of bounce 0 that arrives, a path ray of bounce 1 that finds a light or the sky."""
INDIRECT = 6
"""All other light. So a contribution begins at column 3 x min(bounce + (1 for a shadow ray), 2), or at 0 where there is one part."""
ONE_PART = 3
THREE_PARTS = 9

ALBEDO = 0
NORMAL = 3
"""Shading normal in world space, turned to where the ray came from."""
DEPTH = 6
"""Distance from the camera (orthographic: from its plane), less that at which the job's box begins, as a share of the box's diagonal:
so it lies within 0 and 1 wherever the camera is."""
DEPTH_END = 2.0
"""What it is cut off at, for whole numbers' sake; no hit comes near it."""
HIT = 7
PLAIN_AOVS = 8
POSITION = 8
"""In world space, each coordinate as a share of the job's box from its low end."""
OBJECT = 11
"""The instance's number; 0 is what is not instanced."""
MATERIAL = 12
ALL_AOVS = 13


@dataclass(frozen=True, slots=True)
class SumColumns:
    """How many columns the sums of a job have."""

    radiance: int = ONE_PART
    aovs: int = PLAIN_AOVS

    def __post_init__(self) -> None:
        assert self.radiance in (ONE_PART, THREE_PARTS) and self.aovs in (PLAIN_AOVS, ALL_AOVS), "no such columns"

    def within(self, other: SumColumns) -> bool:
        """Whether the other columns hold all of these."""
        return self.radiance <= other.radiance and self.aovs <= other.aovs

    @property
    def feature_sums(self) -> int:
        """Columns of `aovs` that are added up over the paths of a pixel: all but HIT, which is counted, and the numbers."""
        return HIT + (CHANNELS if self.aovs == ALL_AOVS else 0)


PLAIN = SumColumns()
FULL = SumColumns(THREE_PARTS, ALL_AOVS)
