"""Space-filling curves: cells of a space to locations on the line and back, boxes to few arcs, world to cells.

Light to import: numpy comes with the first `Lattice` and numba with the first use of a `Curve`, so that the
command line starts fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from scenefold.curve.curves import Curve, CurveFault, CurveKind

if TYPE_CHECKING:
    from scenefold.curve.lattice import Lattice
    from scenefold.curve.measure import curve_works, random_cells

__all__ = [
    "Curve",
    "CurveFault",
    "CurveKind",
    "Lattice",
    "curve_works",
    "random_cells",
]


def __getattr__(name: str) -> Any:
    if name == "Lattice":
        from scenefold.curve.lattice import Lattice

        return Lattice
    if name in {"curve_works", "random_cells"}:
        from scenefold.curve import measure

        return getattr(measure, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
