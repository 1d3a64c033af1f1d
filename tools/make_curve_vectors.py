"""Writes specs/vectors/curves.json: what any implementation of specs/02-curves.md must give.

    .venv/bin/python tools/make_curve_vectors.py

Cells are also checked against the slow reference in tests/unit/curve, by tests/unit/curve/test_curves.py.
Numbers are strings: JSON's would be floats in some readers.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

import numpy as np

from scenefold.base.location import Location
from scenefold.curve import Curve, CurveKind

TARGET = Path(__file__).parents[1] / "specs" / "vectors" / "curves.json"


def main() -> None:
    """Make the file anew; it changes only when a curve does, which breaks every stored scene."""
    cells: list[dict[str, Any]] = []
    arcs: list[dict[str, Any]] = []
    for kind in get_args(CurveKind):
        for dimensions in range(1, 9):
            curve = Curve(kind, dimensions)
            cells += [_cell_row(curve, cell) for cell in _cells(curve)]
            arcs += [_arcs_row(curve, limit) for limit in ((1, 100) if dimensions <= 5 else (1,))]
    lines = [
        f' "{name}": [\n' + ",\n".join("  " + json.dumps(row) for row in rows) + "\n ]" for name, rows in (("cells", cells), ("arcs", arcs))
    ]
    TARGET.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def _cells(curve: Curve) -> list[list[int]]:
    top = (1 << curve.cell_bits) - 1
    random = np.random.default_rng(curve.dimensions)
    drawn = random.integers(0, top, (6, curve.dimensions), dtype=np.uint64, endpoint=True).tolist()
    one_each = [[top if axis == chosen else 0 for axis in range(curve.dimensions)] for chosen in range(curve.dimensions)]
    return [[0] * curve.dimensions, [top] * curve.dimensions, *one_each, *drawn]


def _cell_row(curve: Curve, cell: list[int]) -> dict[str, Any]:
    location = Location.from_padded(curve.encode([cell]).tolist()[0])
    return {"kind": curve.kind, "dimensions": curve.dimensions, "cell": [str(number) for number in cell], "location": location.hex()}


def _arcs_row(curve: Curve, limit: int) -> dict[str, Any]:
    """The hull and the exact arcs of a box around the middle, both curves' worst place: there is one right answer."""
    middle = 1 << (curve.cell_bits - 1)
    low, high = [middle - 1] * curve.dimensions, [middle + (axis + 1) % 2 for axis in range(curve.dimensions)]
    return {
        "kind": curve.kind,
        "dimensions": curve.dimensions,
        "low": [str(number) for number in low],
        "high": [str(number) for number in high],
        "limit": limit,
        "arcs": [[first.hex(), last.hex()] for first, last in curve.arcs(low, high, limit)],
    }


if __name__ == "__main__":
    main()
