"""`Lattice`: the grid of cells that a curve's space lays over a box of the world (specs/02-curves.md, Lattice).

Along an axis from `low` to `high` there are 2^m cells, m = curve.cell_bits; cell c begins at
low + c / 2^m · (high - low). What lies outside goes to the nearest cell, so that every point has one, and a
box of points maps to a box of cells that holds them all (the map is monotone in every coordinate).

float64 has 53 bits: beyond that the low bits of a cell number are what rounding left, the same everywhere, as
only +, -, * and / by powers of two and one division are used. An axis without extent has all points in cell 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from scenefold.curve.shape import CurveFault

if TYPE_CHECKING:
    from scenefold.curve.curves import Curve

Points = npt.NDArray[np.float64]
Cells = npt.NDArray[np.uint64]


@dataclass(frozen=True, eq=False)
class Lattice:
    """Cells of `curve` over the world box low..high (float64[D]; finite, low <= high)."""

    curve: Curve
    low: Points
    high: Points
    _shrink: Points = field(init=False, repr=False)
    """1, or 1/2 where the extent itself would overflow."""
    _extent: Points = field(init=False, repr=False)

    def __post_init__(self) -> None:
        low, high = (_row(self.curve, corner, "corner of a lattice").copy() for corner in (self.low, self.high))
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise CurveFault(f"a lattice lies over a finite box, not {low} to {high}")
        if (low > high).any():
            raise CurveFault(f"a lattice begins before it ends, not at {low} before {high}")
        with np.errstate(over="ignore"):
            shrink = np.where(np.isfinite(high - low), 1.0, 0.5)
        extent = high * shrink - low * shrink
        for name, value in (("low", low), ("high", high), ("_shrink", shrink), ("_extent", extent)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)

    def cells(self, points: npt.ArrayLike) -> Cells:
        """Cells uint64[n, D] of points float64[n, D]; the nearest for points outside, infinite ones included.

        CurveFault for NaN.
        """
        positions = _rows(self.curve, points)
        if np.isnan(positions).any():
            row = int(np.argmax(np.isnan(positions).any(axis=1)))
            raise CurveFault(f"a point has no place: {positions[row]}", where=f"point {row}")
        with np.errstate(over="ignore", divide="ignore", invalid="ignore", under="ignore"):
            fractions = (positions * self._shrink - self.low * self._shrink) / self._extent
        fractions[:, self._extent == 0.0] = 0.0
        below_top = np.minimum(np.maximum(fractions, 0.0), np.nextafter(1.0, 0.0))
        cells = (below_top * 2.0**self.curve.cell_bits).astype(np.uint64)
        # The largest float below 1 is not yet the last of 2^64 cells.
        cells[fractions >= 1.0] = (1 << self.curve.cell_bits) - 1
        return cells

    def centres(self, cells: npt.ArrayLike) -> Points:
        """Centres float64[n, D] of cells uint64[n, D], within the lattice's box."""
        numbers = np.asarray(cells)
        if numbers.size == 0:
            numbers = numbers.reshape(0, self.curve.dimensions).astype(np.uint64)
        if numbers.ndim != 2 or numbers.shape[1] != self.curve.dimensions or numbers.dtype.kind not in "ui":
            raise CurveFault(f"cells are whole numbers of shape (n, {self.curve.dimensions}), not {numbers.dtype} {numbers.shape}")
        if numbers.size and not 0 <= int(numbers.min()) <= int(numbers.max()) < 1 << self.curve.cell_bits:
            raise CurveFault(f"a cell number is at least 0 and below 2^{self.curve.cell_bits}")
        fractions = (numbers.astype(np.float64) + 0.5) * 2.0**-self.curve.cell_bits
        centres = (self.low * self._shrink + fractions * self._extent) / self._shrink
        return np.clip(centres, self.low, self.high)

    def box_cells(self, low: npt.ArrayLike, high: npt.ArrayLike) -> tuple[Cells, Cells]:
        """First and last cells (uint64[D] each, as `Curve.arcs` takes them) of the world box low..high.

        They hold every point of the box. A box outside the lattice gives cells at its edge: where points
        outside were put.
        """
        corners = np.stack([_row(self.curve, corner, "corner of a box") for corner in (low, high)])
        if (corners[0] > corners[1]).any():
            raise CurveFault(f"a box begins before it ends, not at {corners[0]} before {corners[1]}")
        first, last = self.cells(corners)
        return first, last


def _row(curve: Curve, corner: npt.ArrayLike, what: str) -> Points:
    row = _floats(corner)
    if row.shape != (curve.dimensions,):
        raise CurveFault(f"a {what} has {curve.dimensions} coordinates, not shape {row.shape}")
    return row


def _rows(curve: Curve, points: npt.ArrayLike) -> Points:
    rows = _floats(points)
    if rows.size == 0 and rows.ndim <= 2:
        return rows.reshape(0, curve.dimensions)
    if rows.ndim != 2 or rows.shape[1] != curve.dimensions:
        raise CurveFault(f"points of {curve.dimensions} dimensions have shape (n, {curve.dimensions}), not {rows.shape}")
    return rows


def _floats(values: npt.ArrayLike) -> Points:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CurveFault(f"coordinates are numbers: {error}") from error
