"""What a curve is before it is computed with: its kind, its dimensions, and the bits that follow from them.

`Curve` (curves.py) adds the work, which operations.py does on arrays; both build on this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from scenefold.base.errors import LocalFault
from scenefold.base.limits import SPACE_DIMENSIONS_MAX
from scenefold.base.location import LOCATION_BITS

CurveKind = Literal["hilbert", "z-order"]

CELL_BITS_MAX = 64
"""A cell number is 64 bits, so that cells travel in ordinary arrays."""


class CurveFault(LocalFault, ValueError):
    """An argument that a curve or a lattice has no meaning for. A ValueError too, as in `base.location`."""


@dataclass(frozen=True, slots=True)
class CurveShape:
    """Kind and dimensions of a curve; CurveFault for what is none."""

    kind: CurveKind
    dimensions: int

    def __post_init__(self) -> None:
        if self.kind not in get_args(CurveKind):
            raise CurveFault(f"there is no curve {self.kind!r}", remedy='use "hilbert" or "z-order"')
        whole = isinstance(self.dimensions, int) and not isinstance(self.dimensions, bool)
        if not whole or not 1 <= self.dimensions <= SPACE_DIMENSIONS_MAX:
            raise CurveFault(f"a space has 1 to {SPACE_DIMENSIONS_MAX} dimensions, not {self.dimensions!r}")

    @property
    def bits(self) -> int:
        """Bits of an axis: floor(160 / D)."""
        return LOCATION_BITS // self.dimensions

    @property
    def cell_bits(self) -> int:
        """Bits of a cell number: `bits`, but at most 64 (then the axis's high ones)."""
        return min(self.bits, CELL_BITS_MAX)
