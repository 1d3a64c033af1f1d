"""If this fails, a caller's slip becomes a wrong location instead of a clear error."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.curve import Curve, CurveFault

CURVE = Curve("hilbert", 3)


def test_faults_are_local_faults_and_value_errors() -> None:
    assert issubclass(CurveFault, LocalFault) and issubclass(CurveFault, ValueError)


@pytest.mark.parametrize(
    ("kind", "dimensions"), [("peano", 3), ("", 1), ("hilbert", 0), ("hilbert", 9), ("z-order", -1), ("hilbert", 2.0), ("hilbert", True)]
)
def test_no_such_curve(kind: Any, dimensions: Any) -> None:
    with pytest.raises(CurveFault):
        Curve(kind, dimensions)


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ([[0, 0, 2**53]], "at most 2\\^53 - 1"),
        ([[0, 0, 2**64]], "at most"),
        ([[2**64, 2**63, 1]], "at most"),
        ([[0, -1, 0]], "0 or more"),
        (np.array([[0, -1, 0]], np.int8), "0 or more"),
        ([[0.5, 0, 0]], "whole"),
        (np.zeros((2, 3)), "whole"),
        ([[True, False, True]], "whole"),
        ([["a", "b", "c"]], "whole"),
        ([[0, 0]], "shape"),
        ([0, 0, 0], "shape"),
        ([[[0, 0, 0]]], "shape"),
        ([[0, 0], [0, 0, 0]], "rows"),
    ],
)
def test_cells_that_are_none(cells: Any, says: str) -> None:
    with pytest.raises(CurveFault, match=says):
        CURVE.encode(cells)


@pytest.mark.parametrize("locations", [b"single", "text", [b"x" * 21], ["text"], [1], np.zeros((2, 20), np.uint8), np.array([b"x" * 21])])
def test_locations_that_are_none(locations: Any) -> None:
    with pytest.raises(CurveFault):
        CURVE.decode(locations)


@pytest.mark.parametrize(
    ("low", "high", "limit", "says"),
    [
        ([0, 0, 0], [1, 1, 1], 0, "limit"),
        ([0, 0, 0], [1, 1, 1], -5, "limit"),
        ([0, 0, 0], [1, 1, 1], 1.5, "limit"),
        ([0, 2, 0], [1, 1, 1], 4, "axis 1"),
        ([0, 0], [1, 1, 1], 4, "corner"),
        (0, [1, 1, 1], 4, "corner"),
        ([0, 0, 0], [1, 1, 2**53], 4, "at most"),
        ([0, 0, -1], [1, 1, 1], 4, "0 or more"),
        ([0, 0, 0.0], [1, 1, 1], 4, "whole"),
    ],
)
def test_boxes_that_are_none(low: Any, high: Any, limit: Any, says: str) -> None:
    with pytest.raises(CurveFault, match=says):
        CURVE.arcs(low, high, limit)


def test_importing_the_package_loads_neither_numba_nor_numpy() -> None:
    code = "import sys, scenefold.curve as c; c.Curve('hilbert', 3).bits; print({'numba', 'numpy'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"
