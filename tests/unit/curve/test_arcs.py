"""If this fails, a query of a box misses records, or asks far too much of the line."""

from __future__ import annotations

import itertools
import json
from functools import cache

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.limits import CURVE_ARCS_MAX
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location
from scenefold.curve import Curve
from unit.curve.slow_reference import best_cover_length, runs_of
from unit.curve.test_curves import ALL, VECTORS, every_curve, numbers

LEVELS = {1: 10, 2: 6, 3: 4, 4: 3, 5: 2, 6: 2, 7: 2, 8: 2}
"""Levels of the coarse grids that are searched by looking at every cell."""

Arcs = list[tuple[bytes, bytes]]


def as_numbers(arcs: Arcs) -> list[tuple[int, int]]:
    return [(int.from_bytes(first, "big"), int.from_bytes(last, "big")) for first, last in arcs]


def check_form(arcs: Arcs, limit: int) -> None:
    assert 1 <= len(arcs) <= limit
    assert all(type(end) is bytes and len(end) == 20 for arc in arcs for end in arc)
    ends = list(itertools.chain.from_iterable(as_numbers(arcs)))
    assert all(first <= last for first, last in as_numbers(arcs))
    assert all(last + 1 < first for last, first in zip(ends[1:-1:2], ends[2::2], strict=True)), "disjoint, not touching"


@cache
def coarse_cells(kind: str, dimensions: int) -> np.ndarray:
    """All cells of a coarse grid in curve order."""
    level = LEVELS[dimensions]
    shift = 160 - dimensions * level
    curve = Curve(kind, dimensions)
    locations = [(index << shift).to_bytes(20, "big") for index in range(1 << dimensions * level)]
    return curve.decode(locations) >> np.uint64(curve.cell_bits - level)


@st.composite
def coarse_boxes(draw: st.DrawFn) -> tuple[Curve, list[int], list[int]]:
    kind, dimensions = draw(st.sampled_from(ALL))
    last = (1 << LEVELS[dimensions]) - 1
    ends = [sorted(draw(st.tuples(st.integers(0, last), st.integers(0, last)))) for _ in range(dimensions)]
    return Curve(kind, dimensions), [low for low, _ in ends], [high for _, high in ends]


@settings(max_examples=150)
@given(coarse_boxes(), st.one_of(st.integers(1, 12), st.integers(13, 100), st.just(10**6)))
def test_best_cover_of_coarse_boxes(case: tuple[Curve, list[int], list[int]], limit: int) -> None:
    curve, low, high = case
    level = LEVELS[curve.dimensions]
    fine = curve.cell_bits - level
    arcs = curve.arcs([number << fine for number in low], [(number + 1 << fine) - 1 for number in high], limit)
    check_form(arcs, limit)
    cells = coarse_cells(curve.kind, curve.dimensions)
    within = np.flatnonzero(((cells >= np.array(low, np.uint64)) & (cells <= np.array(high, np.uint64))).all(axis=1)).tolist()
    shift = 160 - curve.dimensions * level
    coarse = [(first >> shift, last >> shift) for first, last in as_numbers(arcs)]
    assert as_numbers(arcs) == [(first << shift, (last + 1 << shift) - 1) for first, last in coarse], "ends on coarse cells"
    runs = runs_of(within)
    if len(runs) <= limit:
        assert coarse == runs
    else:
        assert set(within) <= set(itertools.chain.from_iterable(range(first, last + 1) for first, last in coarse))
        assert sum(last - first + 1 for first, last in coarse) == best_cover_length(within, limit)


@st.composite
def tiny_boxes(draw: st.DrawFn) -> tuple[Curve, list[int], list[int]]:
    """A few cells wide, anywhere, in cells of the full resolution."""
    kind, dimensions = draw(st.sampled_from(ALL))
    curve = Curve(kind, dimensions)
    side_max = {1: 1000, 2: 40, 3: 12, 4: 6, 5: 4, 6: 3, 7: 2, 8: 2}[dimensions]
    low, high = [], []
    for _ in range(dimensions):
        side = draw(st.integers(1, side_max))
        last = (1 << curve.cell_bits) - side
        begin = draw(st.one_of(st.integers(0, last), st.just(0), st.just(last), st.just(last // 2)))
        low.append(begin)
        high.append(begin + side - 1)
    return curve, low, high


@settings(max_examples=150)
@given(tiny_boxes(), st.sampled_from([1, 2, 7, 64, 5000]))
def test_tiny_boxes_to_the_last_cell(case: tuple[Curve, list[int], list[int]], limit: int) -> None:
    curve, low, high = case
    arcs = curve.arcs(low, high, limit)
    check_form(arcs, limit)
    cells = list(itertools.product(*(range(begin, last + 1) for begin, last in zip(low, high, strict=True))))
    cell_length = 160 - curve.dimensions * curve.cell_bits
    # With one or two dimensions the curve winds on below a cell: its index is the prefix.
    indexes = [number >> cell_length for number in numbers(curve.encode(cells))]
    covered = [(first >> cell_length, last >> cell_length) for first, last in as_numbers(arcs)]
    assert as_numbers(arcs) == [(first << cell_length, (last + 1 << cell_length) - 1) for first, last in covered]
    runs = runs_of(indexes)
    if len(runs) <= limit:
        assert covered == runs
    else:
        assert all(any(first <= begin and last >= end for first, last in covered) for begin, end in runs)
        assert {covered[0][0], covered[-1][1]} == {runs[0][0], runs[-1][1]}


@st.composite
def any_boxes(draw: st.DrawFn) -> tuple[Curve, list[int], list[int]]:
    kind, dimensions = draw(st.sampled_from(ALL))
    curve = Curve(kind, dimensions)
    top = (1 << curve.cell_bits) - 1
    number = st.one_of(st.integers(0, top), st.sampled_from([0, 1, top - 1, top, top // 2, top // 2 + 1]))
    ends = [sorted(draw(st.tuples(number, number))) for _ in range(dimensions)]
    return curve, [low for low, _ in ends], [high for _, high in ends]


@settings(max_examples=150)
@given(any_boxes(), st.integers(1, 80), st.integers(0, 2**32))
def test_every_cell_of_any_box_is_covered(case: tuple[Curve, list[int], list[int]], limit: int, seed: int) -> None:
    curve, low, high = case
    arcs = curve.arcs(low, high, limit)
    check_form(arcs, limit)
    random = np.random.default_rng(seed)
    columns = [random.integers(begin, last, 200, dtype=np.uint64, endpoint=True) for begin, last in zip(low, high, strict=True)]
    cells = np.stack(columns, axis=1)
    cells[:2] = low, high
    firsts = [first for first, _ in as_numbers(arcs)]
    lasts = np.array([last for _, last in as_numbers(arcs)], dtype=object)
    for number in numbers(curve.encode(cells)):
        assert number <= lasts[np.searchsorted(np.array(firsts, dtype=object), number, side="right") - 1]
    # Arcs begin and end in the box.
    for end in itertools.chain.from_iterable(arcs):
        cell = curve.decode([end])[0].tolist()
        assert all(begin <= number <= last for begin, number, last in zip(low, cell, high, strict=True))


@settings(max_examples=60)
@given(any_boxes())
def test_a_higher_limit_never_covers_more(case: tuple[Curve, list[int], list[int]]) -> None:
    curve, low, high = case
    lengths = [sum(last - first for first, last in as_numbers(curve.arcs(low, high, limit))) for limit in (1, 3, 9)]
    # Where the frontier is cut short, which gaps are found depends on the limit a little.
    assert lengths[0] >= lengths[1] >= lengths[2] * 0.9


@every_curve
def test_the_whole_space_is_the_whole_line(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    for limit in (1, 64, 10**9):
        assert curve.arcs([0] * dimensions, [(1 << curve.cell_bits) - 1] * dimensions, limit) == [(bytes(FIRST), bytes(LAST))]


@every_curve
def test_one_cell_is_one_arc_with_all_its_low_bits(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    top = (1 << curve.cell_bits) - 1
    for cell in ([0] * dimensions, [top] * dimensions, [top] + [0] * (dimensions - 1), [top // 3] * dimensions):
        ((first, last),) = as_numbers(curve.arcs(cell, cell, 5))
        length = 1 << (160 - dimensions * curve.cell_bits)
        assert last - first + 1 == length and first % length == 0
        assert first <= numbers(curve.encode([cell]))[0] <= last


@every_curve
def test_nasty_boxes_end(kind: str, dimensions: int) -> None:
    curve = Curve(kind, dimensions)
    top = (1 << curve.cell_bits) - 1
    slab_low, slab_high = [0] * dimensions, [top] * dimensions
    slab_low[-1] = slab_high[-1] = top // 3
    for low, high in ((slab_low, slab_high), ([1] * dimensions, [top] * dimensions), ([0] * dimensions, [top - 1] * dimensions)):
        for limit in (1, 2, 64, 300):
            check_form(curve.arcs(low, high, limit), limit)


def test_all_but_one_plane_of_cells() -> None:
    curve = Curve("hilbert", 3)
    top = (1 << 53) - 1
    arcs = as_numbers(curve.arcs([1, 0, 0], [top] * 3, 64))
    assert 2 <= len(arcs) <= 64
    assert sum(last - first + 1 for first, last in arcs) > LINE_LENGTH - (1 << 110)


def test_a_limit_beyond_the_bound_is_the_bound() -> None:
    arcs = Curve("hilbert", 2).arcs([5, 5], [200, 100], CURVE_ARCS_MAX * 10)
    check_form(arcs, CURVE_ARCS_MAX)


def test_corners_may_be_arrays() -> None:
    curve = Curve("z-order", 2)
    low, high = np.array([3, 4], np.uint64), np.array([2**64 - 1, 9], np.uint64)
    assert curve.arcs(low, high, 8) == curve.arcs([3, 4], [2**64 - 1, 9], 8)


def test_golden_vectors() -> None:
    for row in json.loads(VECTORS.read_text())["arcs"]:
        low, high = ([int(number) for number in row[corner]] for corner in ("low", "high"))
        arcs = Curve(row["kind"], row["dimensions"]).arcs(low, high, row["limit"])
        assert [[Location(end).hex() for end in arc] for arc in arcs] == row["arcs"]
