"""If this fails, things of the scene are filed under places where nobody looks for them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.curve import Curve, CurveFault, Lattice

finite = st.floats(allow_nan=False, allow_infinity=False)
sensible = st.floats(-1e9, 1e9)


def lattice_of(dimensions: int, low: float = -1.0, high: float = 3.0) -> Lattice:
    return Lattice(Curve("hilbert", dimensions), np.full(dimensions, low), np.full(dimensions, high))


@pytest.mark.parametrize("dimensions", range(1, 9))
def test_corners_fall_into_the_first_and_last_cell(dimensions: int) -> None:
    lattice = lattice_of(dimensions)
    top = (1 << lattice.curve.cell_bits) - 1
    points = np.array(
        [[-1.0] * dimensions, [3.0] * dimensions, [-9.0] * dimensions, [9e300] * dimensions, [-np.inf] * dimensions, [np.inf] * dimensions]
    )
    cells = lattice.cells(points)
    assert cells.dtype == np.uint64
    assert cells.tolist() == [[number] * dimensions for number in (0, top, 0, top, 0, top)]
    assert lattice.cells(np.full((1, dimensions), 1.0)).tolist() == [[top // 2 + 1] * dimensions]
    assert lattice.curve.decode(lattice.curve.encode(cells)).tolist() == cells.tolist()


@pytest.mark.parametrize("dimensions", [3, 4, 8])
def test_the_centre_of_a_cell_lies_in_it(dimensions: int) -> None:
    lattice = lattice_of(dimensions, 0.0, 1.0)
    top = (1 << lattice.curve.cell_bits) - 1
    random = np.random.default_rng(5)
    # From half way up a float64 has no bit left for the centre of 2^53 cells.
    cells = random.integers(0, top // 4, (300, dimensions), dtype=np.uint64)
    assert (lattice.cells(lattice.centres(cells)) == cells).all()


@pytest.mark.parametrize("dimensions", [1, 2, 3])
def test_fine_cells_come_back_up_to_rounding(dimensions: int) -> None:
    lattice = lattice_of(dimensions)
    bits = lattice.curve.cell_bits
    cells = np.array([[0] * dimensions, [(1 << bits) - 1] * dimensions, [(1 << bits) // 3] * dimensions], np.uint64)
    centres = lattice.centres(cells)
    assert (centres >= lattice.low).all() and (centres <= lattice.high).all()
    back = lattice.cells(centres)
    difference = np.where(back > cells, back - cells, cells - back)
    assert (difference <= 1 << max(0, bits - 50)).all()


@given(
    st.lists(st.tuples(finite, finite, finite), min_size=1, max_size=10),
    st.tuples(finite, finite, finite),
    st.tuples(finite, finite, finite),
)
def test_any_finite_box_and_points(points: list[tuple[float, float, float]], one: tuple[float, ...], other: tuple[float, ...]) -> None:
    low, high = np.minimum(one, other), np.maximum(one, other)
    lattice = Lattice(Curve("z-order", 3), low, high)
    cells = lattice.cells(points)
    assert (cells < 1 << 53).all()
    centres = lattice.centres(cells)
    assert np.isfinite(centres).all() and (centres >= low).all() and (centres <= high).all()


@given(st.lists(st.tuples(sensible, sensible), min_size=2, max_size=20), st.tuples(sensible, sensible), st.tuples(sensible, sensible))
def test_a_box_of_cells_holds_all_points_of_the_box(
    points: list[tuple[float, float]], one: tuple[float, ...], other: tuple[float, ...]
) -> None:
    lattice = Lattice(Curve("hilbert", 2), np.minimum(one, other), np.maximum(one, other))
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    first, last = lattice.box_cells(low, high)
    cells = lattice.cells(points)
    assert (cells >= first).all() and (cells <= last).all()
    assert lattice.curve.arcs(first, last, 4)


def test_an_axis_without_extent_is_one_cell() -> None:
    lattice = Lattice(Curve("hilbert", 3), np.array([0.0, 2.0, 0.0]), np.array([1.0, 2.0, 5e-324]))
    assert lattice.cells([[0.5, 2.0, 0.0], [0.5, 7.0, 0.0], [0.5, -np.inf, 0.0]])[:, 1].tolist() == [0, 0, 0]
    assert lattice.centres([[0, 0, 0]])[0, 1] == 2.0
    first, last = lattice.box_cells([0.0, -5.0, 0.0], [1.0, 5.0, 0.0])
    assert (first[1], last[1]) == (0, 0)


def test_an_extent_that_would_overflow() -> None:
    lattice = lattice_of(3, -1.7e308, 1.7e308)
    assert lattice.cells([[-1.7e308, 0.0, 1.7e308]]).tolist() == [[0, 1 << 52, (1 << 53) - 1]]
    assert abs(lattice.centres([[0, 1 << 52, 0]])[0, 1]) < 1e300


def test_nothing() -> None:
    lattice = lattice_of(3)
    assert lattice.cells([]).shape == (0, 3) and lattice.cells(np.empty((0, 3))).dtype == np.uint64
    assert lattice.centres(np.empty((0, 3), np.uint64)).shape == (0, 3)


def test_the_corners_are_the_lattices_own() -> None:
    low = np.zeros(3)
    lattice = Lattice(Curve("hilbert", 3), low, np.ones(3))
    low[0] = 9.0
    assert lattice.low.tolist() == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        lattice.low[0] = 1.0


def test_faults() -> None:
    curve = Curve("hilbert", 3)
    zeros, ones = np.zeros(3), np.ones(3)
    for low, high in (
        (ones, zeros),
        (zeros, [1.0, np.inf, 1.0]),
        ([0.0, np.nan, 0.0], ones),
        (zeros, [1.0, 1.0]),
        (0.0, 1.0),
        (["a"] * 3, ones),
    ):
        with pytest.raises(CurveFault):
            Lattice(curve, low, high)
    lattice = Lattice(curve, zeros, ones)
    with pytest.raises(CurveFault, match="point 1"):
        lattice.cells([[0.0, 0.0, 0.0], [0.0, np.nan, 0.0]])
    for points in ([[0.0, 0.0]], [0.0, 0.0, 0.0], [["a", "b", "c"]]):
        with pytest.raises(CurveFault):
            lattice.cells(points)
    for low, high in ((ones, zeros), ([np.nan, 0.0, 0.0], ones), (zeros, [1.0])):
        with pytest.raises(CurveFault):
            lattice.box_cells(low, high)
    for cells in ([[0, 0]], [[0.5, 0.5, 0.5]], [[0, 0, 2**53]], [[-1, 0, 0]]):
        with pytest.raises(CurveFault):
            lattice.centres(cells)
