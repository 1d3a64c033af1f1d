"""If this fails, locations are wrong: records would be stored and looked for at different places."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.location import Location
from scenefold.curve import Curve
from unit.curve import slow_reference

KINDS = ("hilbert", "z-order")
ALL = [(kind, dimensions) for kind in KINDS for dimensions in range(1, 9)]
every_curve = pytest.mark.parametrize(("kind", "dimensions"), ALL)
VECTORS = Path(__file__).parents[3] / "specs" / "vectors" / "curves.json"


def numbers(locations: np.ndarray) -> list[int]:
    return [Location.from_padded(location).number for location in locations.tolist()]


def cells_strategy(dimensions: int) -> st.SearchStrategy[list[list[int]]]:
    last = (1 << Curve("hilbert", dimensions).cell_bits) - 1
    number = st.one_of(st.integers(0, last), st.integers(0, min(7, last)), st.integers(max(0, last - 7), last))
    return st.lists(st.lists(number, min_size=dimensions, max_size=dimensions), min_size=1, max_size=8)


@st.composite
def curves_with_cells(draw: st.DrawFn) -> tuple[Curve, list[list[int]]]:
    kind, dimensions = draw(st.sampled_from(ALL))
    return Curve(kind, dimensions), draw(cells_strategy(dimensions))


def test_bits() -> None:
    assert [Curve("hilbert", dimensions).bits for dimensions in range(1, 9)] == [160, 80, 53, 40, 32, 26, 22, 20]


@given(curves_with_cells())
def test_decoding_undoes_encoding(case: tuple[Curve, list[list[int]]]) -> None:
    curve, cells = case
    locations = curve.encode(cells)
    assert locations.dtype == np.dtype("S20") and locations.shape == (len(cells),)
    decoded = curve.decode(locations)
    assert decoded.dtype == np.uint64 and decoded.tolist() == cells


@settings(max_examples=60)
@given(curves_with_cells())
def test_equals_the_slow_reference(case: tuple[Curve, list[list[int]]]) -> None:
    curve, cells = case
    expected = [slow_reference.location_of(curve.kind, cell) for cell in cells]
    assert [Location.from_padded(location) for location in curve.encode(cells).tolist()] == expected


@given(st.sampled_from(ALL), st.lists(st.binary(min_size=20, max_size=20), min_size=1, max_size=8))
def test_any_location_has_a_cell(which: tuple[str, int], locations: list[bytes]) -> None:
    curve = Curve(*which)
    cells = curve.decode(locations)
    assert cells.tolist() == [slow_reference.cell_at(curve.kind, location, curve.dimensions) for location in locations]
    unused = 160 - curve.dimensions * curve.bits
    if curve.dimensions > 2:
        # A cell's location is the given one without the spare bits.
        assert numbers(curve.encode(cells)) == [int.from_bytes(location, "big") >> unused << unused for location in locations]


@every_curve
def test_byte_order_is_curve_order(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    random = np.random.default_rng(dimensions)
    cells = random.integers(0, (1 << curve.cell_bits) - 1, (500, dimensions), dtype=np.uint64, endpoint=True)
    locations = curve.encode(cells)
    by_bytes = sorted(range(500), key=lambda i: bytes(locations[i]).ljust(20, b"\0"))
    assert by_bytes == np.argsort(numbers(locations), kind="stable").tolist()
    assert sorted(locations.tolist()) == np.sort(locations).tolist()


def walk(curve: Curve, level: int, first: int, count: int) -> np.ndarray:
    """Cells of that many bits an axis, at consecutive curve indexes."""
    shift = 160 - curve.dimensions * level
    last = min(first + count, 1 << curve.dimensions * level)
    locations = [Location.from_number(index << shift) for index in range(first, last)]
    return curve.decode(locations) >> np.uint64(curve.cell_bits - level)


def distances(cells: np.ndarray) -> np.ndarray:
    return np.abs(np.diff(cells.astype(np.int64), axis=0)).sum(axis=1)


@pytest.mark.parametrize("dimensions", range(1, 9))
def test_hilbert_goes_from_neighbour_to_neighbour(dimensions: int) -> None:
    curve = Curve("hilbert", dimensions)
    for level in range(1, 5):
        cells = walk(curve, level, 0, 40_000)
        assert (distances(cells) == 1).all()
        if len(cells) == 1 << dimensions * level:
            assert len(np.unique(cells, axis=0)) == len(cells), "every cell once"
            assert cells[0].tolist() == [0] * dimensions and (cells[-1] > 0).sum() == 1, "from a corner along one edge"


@given(st.integers(1, 8), st.data())
def test_hilbert_neighbours_anywhere_and_at_any_level(dimensions: int, data: st.DataObject) -> None:
    curve = Curve("hilbert", dimensions)
    level = data.draw(st.integers(1, min(curve.cell_bits, 62)))
    first = data.draw(st.integers(0, (1 << dimensions * level) - 1))
    assert (distances(walk(curve, level, first, 20)) == 1).all()


def test_z_order_is_the_interleaving_with_axis_0_first() -> None:
    number = numbers(Curve("z-order", 3).encode([[0b10, 0b01, 0b11]]))[0]
    assert number == 0b101_011 << 1, "the 159 bits stand left, one spare bit stays right"


@given(curves_with_cells(), st.data())
def test_a_prefix_of_the_location_is_the_parent_cell(case: tuple[Curve, list[list[int]]], data: st.DataObject) -> None:
    curve, cells = case
    level = data.draw(st.integers(0, curve.cell_bits))
    below = curve.cell_bits - level
    parents = [[number >> below << below for number in cell] for cell in cells]
    keep = 160 - curve.dimensions * level
    assert [n >> keep for n in numbers(curve.encode(cells))] == [n >> keep for n in numbers(curve.encode(parents))]


@pytest.mark.parametrize("kind", KINDS)
def test_with_one_or_two_dimensions_a_cell_is_the_high_bits(kind: str) -> None:
    one = Curve(kind, 1)
    assert numbers(one.encode([[1], [2**64 - 1]])) == [1 << 96, (2**64 - 1) << 96]
    assert one.decode([Location.from_number((5 << 96) + 12345)]).tolist() == [[5]]
    two = Curve(kind, 2)
    cells = [[2**64 - 1, 3], [0, 0], [2**63, 2**63]]
    assert two.decode(two.encode(cells)).tolist() == cells
    whole_axes = [[number << 16 for number in cell] for cell in cells]
    assert numbers(two.encode(cells)) == [slow_reference.index_of(kind, axis, 80) for axis in whole_axes]


@every_curve
def test_spare_bits_are_zero_when_encoded_and_ignored_when_decoded(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    spare = 160 - dimensions * curve.bits
    top = [[(1 << curve.cell_bits) - 1] * dimensions]
    number = numbers(curve.encode(top))[0]
    assert number % (1 << spare) == 0
    assert curve.decode([Location.from_number(number | ((1 << spare) - 1))]).tolist() == top


@every_curve
def test_golden_vectors(kind: str, dimensions: int) -> None:
    rows = [row for row in json.loads(VECTORS.read_text())["cells"] if (row["kind"], row["dimensions"]) == (kind, dimensions)]
    assert rows
    for row in rows:
        cells = [[int(number) for number in row["cell"]]]
        assert Curve(kind, dimensions).encode(cells)[0].ljust(20, b"\0").hex() == row["location"]
        assert slow_reference.location_of(kind, cells[0]).hex() == row["location"]


def test_locations_of_all_forms_are_read() -> None:
    curve = Curve("hilbert", 3)
    cells = np.array([[1, 2, 3], [2**52, 0, 0], [0, 0, 0]], np.uint64)
    locations = curve.encode(cells)
    padded = [Location.from_padded(location) for location in locations]
    for form in (locations, list(locations), padded, np.array(padded, dtype="S20"), tuple(map(bytes, padded)), locations[::-1][::-1]):
        assert (curve.decode(form) == cells).all()
    assert curve.decode(locations[1:2].astype("S25")).tolist() == [[2**52, 0, 0]]
    assert curve.decode([b""]).tolist() == [[0, 0, 0]]


def test_cells_of_all_forms_are_read() -> None:
    curve = Curve("hilbert", 2)
    expected = curve.encode(np.array([[2**64 - 1, 1]], np.uint64)).tolist()
    assert curve.encode([[2**64 - 1, 1]]).tolist() == expected
    assert curve.encode([(np.uint64(2**64 - 1), 1)]).tolist() == expected
    assert curve.encode([[2**63, 1], [1, 2]]).shape == (2,)
    small = np.array([[3, 4]])
    for dtype in (np.int8, np.uint16, np.int32, np.int64, np.uint64):
        assert curve.encode(small.astype(dtype)).tolist() == curve.encode([[3, 4]]).tolist()
    columns = np.asfortranarray(np.arange(8, dtype=np.uint64).reshape(4, 2))
    assert curve.encode(columns).tolist() == curve.encode(columns.tolist()).tolist()


@every_curve
def test_nothing_becomes_nothing(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    for empty in ([], np.empty((0, dimensions), np.uint64)):
        assert curve.encode(empty).shape == (0,) and curve.encode(empty).dtype == np.dtype("S20")
    for nothing in ([], np.empty(0, "S20"), ()):
        assert curve.decode(nothing).shape == (0, dimensions) and curve.decode(nothing).dtype == np.uint64
