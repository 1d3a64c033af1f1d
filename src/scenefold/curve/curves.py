"""`Curve`: what the other floors see of a space-filling curve (thesis B.3, specs/02-curves.md).

    cells uint64[n, D]  --encode-->  locations S20[n]  --decode-->  cells uint64[n, D]
    a box of cells      --arcs---->  a few (first, last) of 20 bytes

An axis has `bits` = floor(160 / D) bits. The curve index, D·bits bits, stands in the location's highest bits,
so that every space spans the whole line, whatever its dimensions. With one or two dimensions an axis has
more bits than a cell number: that is the axis's 64 high bits there, the others being 0.

Everything with arrays is in operations.py, imported when first used: numba takes half a second to load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from scenefold.curve.shape import CurveFault, CurveKind, CurveShape

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["Curve", "CurveFault", "CurveKind"]


@dataclass(frozen=True, slots=True)
class Curve(CurveShape):
    """A Hilbert or Z-order curve through a space of 1 to 8 dimensions. Equal if kind and dimensions are."""

    def encode(self, cells: npt.ArrayLike) -> npt.NDArray[np.bytes_]:
        """Locations S20[n] of cells uint64[n, D]: each the first location of its cell.

        Other whole numbers, also in nested lists, are converted. CurveFault for a shape that is not (n, D)
        and for numbers below 0 or from 2^cell_bits on. numpy strips trailing zero bytes from single elements:
        `Location.from_padded` puts them back.
        """
        from scenefold.curve import operations

        return operations.encode(self, cells)

    def decode(self, locations: npt.NDArray[np.bytes_] | Sequence[bytes]) -> npt.NDArray[np.uint64]:
        """Cells uint64[n, D] that hold the locations: an array of bytes (S20), or a sequence of bytes or Location.

        Shorter values are padded with zero bytes; CurveFault for longer ones. Any location has a cell.
        """
        from scenefold.curve import operations

        return operations.decode(self, locations)

    def arcs(self, low: Sequence[int] | npt.NDArray[Any], high: Sequence[int] | npt.NDArray[Any], limit: int) -> list[tuple[bytes, bytes]]:
        """At most `limit` >= 1 arcs (first, last), both included, that cover the cells low..high, both included.

        Ascending and not touching each other. Exactly the box if it is that few arcs; otherwise a superset,
        begun and ended in the box and without its longest gaps. Beyond CURVE_ARCS_MAX a limit means that many.
        """
        from scenefold.curve import operations

        return operations.arcs(self, low, high, limit)
