"""If this fails, a translated or scaled space shows its records in the wrong place, or a box query misses some of them."""

from __future__ import annotations

from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import Affine, LoggedSpace, SceneLog, SpaceFault
from scenefold.scene.log.space import Step
from scenefold.wire import CreateSpace, CurveKind, LogEntry, ScaleSpace, TranslateSpace

KINDS = st.sampled_from(["hilbert", "z-order"])
NUMBERS = st.floats(-1e3, 1e3)
FACTORS = st.floats(1e-2, 1e2)


def space_of(dimensions: int, curve: Any = "hilbert", steps: tuple[Step, ...] = (), **fields: Any) -> LoggedSpace:
    low, high = (-1.0,) * dimensions, (3.0,) * dimensions
    plain = LoggedSpace(SpaceId(11), "hall", dimensions, curve, low, high, Affine.identity(dimensions), **fields)
    for step in steps:
        plain = plain.stepped(step)
    return plain


@st.composite
def steps_of(draw: st.DrawFn, dimensions: int) -> tuple[Step, ...]:
    steps = []
    for position in range(2, 2 + draw(st.integers(0, 4))):
        if draw(st.booleans()):
            steps.append(Step(position, draw(FACTORS), (0.0,) * dimensions))
        else:
            steps.append(Step(position, 1.0, tuple(draw(NUMBERS) for _ in range(dimensions))))
    return tuple(steps)


@given(st.data(), st.integers(1, 8))
def test_a_transform_goes_there_and_back(data: st.DataObject, dimensions: int) -> None:
    space = space_of(dimensions, steps=data.draw(steps_of(dimensions)))
    points = np.array(data.draw(st.lists(st.tuples(*[NUMBERS] * dimensions), min_size=1, max_size=5)))
    there = space.transform.apply(points)
    # What is added to a point is rounded at the size of the sum, and comes back divided by the factor.
    size = np.abs(there).max() + np.abs(space.transform.offset).max() + 1.0
    assert np.abs(space.transform.undo(there) - points).max() <= 4e-16 * (size / space.transform.factor + 1e3)


@given(st.data(), st.integers(1, 8), st.integers(0, 6))
def test_what_was_before_and_what_came_after_make_the_whole(data: st.DataObject, dimensions: int, at: int) -> None:
    space = space_of(dimensions, steps=data.draw(steps_of(dimensions)))
    points = np.array([data.draw(st.tuples(*[NUMBERS] * dimensions))])
    forward = space.fast_forward(space.transform_until(at).apply(points), at)
    np.testing.assert_allclose(forward, space.transform.apply(points), rtol=1e-9, atol=1e-6)


def test_steps_are_taken_in_the_order_of_the_log() -> None:
    by, twice = Step(2, 1.0, (1.0, 0.0)), Step(3, 2.0, (0.0, 0.0))
    assert space_of(2, steps=(by, twice)).transform == Affine(2.0, (2.0, 0.0))
    assert space_of(2, steps=(twice, by)).transform == Affine(2.0, (1.0, 0.0))
    space = space_of(2, steps=(by, twice))
    assert space.fast_forward([[1.0, 1.0]], 2).tolist() == [[2.0, 2.0]]
    assert space.fast_forward([[1.0, 1.0]], 1).tolist() == [[4.0, 2.0]]
    assert space.fast_forward([[1.0, 1.0]], 3).tolist() == [[1.0, 1.0]]


@given(st.integers(1, 8), KINDS, st.data())
@settings(max_examples=60, deadline=None)
def test_a_box_query_finds_what_brute_force_finds(dimensions: int, curve: str, data: st.DataObject) -> None:
    space = space_of(dimensions, curve, data.draw(steps_of(dimensions)))
    dice = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    low, high = (np.array(corner) for corner in space.world_box)
    points = low + dice.random((200, dimensions)) * (high - low)
    corners = np.sort(low + dice.random((2, dimensions)) * (high - low), axis=0)
    # Points exactly on the corners, and some that share one cell.
    points = np.clip(np.concatenate([points, corners, np.repeat(points[:2], 3, axis=0)]), low, high)
    locations = space.locations_of(points)
    box = space.cell_box(corners[0].tolist(), corners[1].tolist())
    arcs = space.box_arcs(corners[0].tolist(), corners[1].tolist(), 16)
    assert 1 <= len(arcs) <= 16
    wanted = ((points >= corners[0]) & (points <= corners[1])).all(axis=1)
    inside = space.in_cells(locations, box)
    in_arcs = np.array([any(location in arc for arc in arcs) for location in locations])
    assert not (wanted & ~inside).any(), "a point in the box is in none of its cells"
    assert not (inside & ~in_arcs).any(), "a cell of the box lies in none of its arcs"
    cells = space.lattice.curve.decode(locations)
    brute = [all(a <= c <= b for a, c, b in zip(box.first, cell, box.last, strict=True)) for cell in cells.tolist()]
    assert inside.tolist() == brute


@given(st.integers(1, 8), KINDS, st.data())
@settings(max_examples=60, deadline=None)
def test_an_address_lies_in_the_world_where_its_point_lay(dimensions: int, curve: str, data: st.DataObject) -> None:
    space = space_of(dimensions, curve, data.draw(steps_of(dimensions)))
    low, high = (np.array(corner) for corner in space.world_box)
    points = low + np.random.default_rng(data.draw(st.integers(0, 99))).random((20, dimensions)) * (high - low)
    there = space.world_of(space.locations_of(points))
    cell = (high - low) / 2.0 ** min(space.lattice.curve.cell_bits, 50)
    assert (np.abs(there - points) <= cell + 1e-12 * (np.abs(low) + np.abs(high))).all()


def test_a_step_moves_what_an_address_means_and_not_the_address() -> None:
    before = space_of(3)
    (place,) = before.locations_of([[0.5, 0.25, 2.0]])
    after = before.stepped(Step(2, 1.0, (10.0, 0.0, 0.0))).stepped(Step(3, 2.0, (0.0, 0.0, 0.0)))
    np.testing.assert_allclose(after.world_of([place]), [[21.0, 0.5, 4.0]], atol=1e-12)
    np.testing.assert_allclose(after.world_of([place], at=2), [[10.5, 0.25, 2.0]], atol=1e-12)
    np.testing.assert_allclose(after.world_of([place], at=1), [[0.5, 0.25, 2.0]], atol=1e-12)
    assert after.locations_of([[21.0, 0.5, 4.0]]) == [place]
    arcs = after.box_arcs((20.9, 0.4, 3.9), (21.1, 0.6, 4.1), 8)
    assert any(place in arc for arc in arcs)


@pytest.mark.parametrize(
    ("low", "high", "complaint"),
    [
        ((0.0,) * 17, (1.0,) * 17, "3 coordinates here, not 17"),
        ((0.0, 0.0), (1.0, 1.0), "3 coordinates here, not 2"),
        ((0.0, 2.0, 0.0), (1.0, 1.0, 1.0), r"ends at 1 before it begins at 2 on axis 1 \(space hall\)"),
        ((0.0, float("nan"), 0.0), (1.0, 1.0, 1.0), "not a number"),
        ((5.0, 0.0, 0.0), (6.0, 1.0, 1.0), r"lies outside of the space \(space hall\): it spans \(-1, -1, -1\) to \(3, 3, 3\)"),
        (("a", "b", "c"), (1.0, 1.0, 1.0), "consists of numbers"),
    ],
)
def test_a_box_that_is_none_is_said_to_be_none(low: Any, high: Any, complaint: str) -> None:
    for ask in (space_of(3).cell_box, lambda a, b: space_of(3).box_arcs(a, b, 8)):
        with pytest.raises(SpaceFault, match=complaint):
            ask(low, high)


def test_a_box_may_reach_beyond_the_space() -> None:
    space = space_of(2)
    assert space.box_arcs((-float("inf"), -9.0), (9.0, float("inf")), 4)[0].length == 1 << 160


@pytest.mark.parametrize("point", [[9.0, 0.0], [float("inf"), 0.0], [float("nan"), 0.0], [1.0], [0.0] * 17])
def test_a_position_outside_has_no_location(point: list[float]) -> None:
    with pytest.raises(SpaceFault):
        space_of(2).locations_of([point])


def test_both_ends_of_the_space_are_inside_after_any_transform() -> None:
    space = space_of(2, steps=(Step(2, 0.1, (0.0, 0.0)), Step(3, 1.0, (0.7, 1e-3)), Step(4, 3.3, (0.0, 0.0))))
    low, high = space.world_box
    assert len(set(space.locations_of([low, high]))) == 2


def test_where_nodes_choose_the_places_there_are_no_positions() -> None:
    space = space_of(1, node_managed=True)
    with pytest.raises(SpaceFault, match="nodes choose"):
        space.box_arcs((0.0,), (1.0,), 4)
    with pytest.raises(SpaceFault, match="nodes choose"):
        space.world_of([Location(bytes(20))])


def logged(*entries: LogEntry, low: float = 0.0, high: float = 1.0, dimensions: int = 3) -> LoggedSpace:
    """The space 11 by the log, which refuses what it must."""
    made = CreateSpace(
        SpaceId(11), dimensions, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, "hall", (low,) * dimensions, (high,) * dimensions
    )
    log = SceneLog()
    for entry in (made, *entries):
        log = log.apply(log.next_record(entry, log.position.to_bytes(16, "big"), NodeId(1)))
    return log.space(SpaceId(11))


def moved(*by: float) -> TranslateSpace:
    return TranslateSpace(SpaceId(11), by)


def grown(by: float) -> ScaleSpace:
    return ScaleSpace(SpaceId(11), by)


def test_a_way_far_out_and_back_costs_no_digit() -> None:
    steps = (Step(2, 1.0, (0.3,)), Step(3, 1.0, (1e15,)), Step(4, 1.0, (-1e15,)))
    assert space_of(1, steps=steps).transform == Affine(1.0, (0.3,))
    assert space_of(1, steps=steps).transform_since(2).is_identity


@given(st.data(), st.integers(1, 8))
def test_translations_there_and_back_are_no_translation(data: st.DataObject, dimensions: int) -> None:
    far = st.floats(-1e15, 1e15)
    way = data.draw(st.lists(st.tuples(*[far] * dimensions), min_size=1, max_size=6))
    back = data.draw(st.permutations([tuple(-step for step in by) for by in way]))
    start = data.draw(steps_of(dimensions))
    steps = (*start, *(Step(9 + index, 1.0, by) for index, by in enumerate([*way, *back])))
    assert space_of(dimensions, steps=steps).transform == space_of(dimensions, steps=start).transform


@given(st.lists(st.one_of(FACTORS, st.floats(1e-100, 1e100)), min_size=1, max_size=8), st.lists(NUMBERS, min_size=8, max_size=8))
def test_a_transform_is_the_exact_one_rounded_once(factors: list[float], offsets: list[float]) -> None:
    transform, factor, offset = Affine.identity(1), Fraction(1), Fraction(0)
    for by, along in zip(factors, offsets, strict=False):
        transform = transform.scaled(by).translated((along,))
        factor, offset = factor * Fraction(by), offset * Fraction(by) + Fraction(along)
        assert transform == Affine(rounded(factor), (rounded(offset),))


def rounded(exact: Fraction) -> float:
    try:
        return exact.numerator / exact.denominator
    except OverflowError:
        return float("inf") if exact > 0 else float("-inf")


@given(st.integers(1, 8), st.data())
@settings(max_examples=80, deadline=None)
def test_what_a_log_accepts_keeps_its_places_apart(dimensions: int, data: st.DataObject) -> None:
    """Of 2^24 places along each axis (fewer where there are fewer cells), neighbours stay two, and each is found where it is shown."""
    entry = st.one_of(
        st.floats(-1e9, 1e9).map(lambda by: moved(*[by] * dimensions)),
        st.floats(1e-160, 1e160).map(grown),
        st.sampled_from([grown(1e-150), grown(2.0**-500), moved(*[1e300] * dimensions), moved(*[1e-300] * dimensions)]),
    )
    low = data.draw(st.sampled_from([0.0, -1.0, 1e6, -3e7]))
    entries: list[LogEntry] = []
    for candidate in data.draw(st.lists(entry, max_size=5)):
        with suppress(Refused):
            logged(*entries, candidate, low=low, high=low + 1.0, dimensions=dimensions)
            entries.append(candidate)
    space = logged(*entries, low=low, high=low + 1.0, dimensions=dimensions)
    curve = space.lattice.curve
    bits = min(curve.cell_bits, 24)
    # The middle of a place, so that what rounding does never puts it across an edge.
    middle, step = (1 << curve.cell_bits - bits) >> 1, 1 << curve.cell_bits - bits
    numbers = [0, 1, *data.draw(st.lists(st.integers(1, (1 << bits) - 2), max_size=4)), (1 << bits) - 2, (1 << bits) - 1]
    cells = np.array([[number * step + middle] * dimensions for number in numbers], np.uint64)
    there = space.world_of(curve.encode(cells))
    again = curve.decode(space.locations_of(there))
    assert (again >> np.uint64(curve.cell_bits - bits)).tolist() == [[number] * dimensions for number in numbers]
    assert (there[0] < there[1]).all() and (there[-2] < there[-1]).all()


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ([moved(0.3, 0.0, 0.0), moved(1e15, 0.0, 0.0)], "from 1e\\+15 to 1e\\+15 on axis 0, so far off for its size"),
        ([moved(0.0, 0.0, -1e9)], "on axis 2, so far off"),
        ([grown(1e-320)], "scaled by 9.99989e-321 in all, less than numbers hold"),
        ([grown(1e-200), grown(1e-110)], "less than numbers hold"),
        ([grown(1e200), grown(1e200)], "leave the range of numbers"),
        ([grown(1e300), moved(1e307, 0.0, 0.0), grown(100.0)], "leave the range of numbers"),
        ([grown(1e-9), moved(1.0, 1.0, 1.0)], "so far off"),
    ],
)
def test_where_numbers_lose_places_no_space_goes(entries: list[LogEntry], complaint: str) -> None:
    logged(*entries[:-1])
    with pytest.raises(Refused, match=complaint) as refused:
        logged(*entries)
    assert refused.value.reason is RejectReason.ILL_FORMED


@pytest.mark.parametrize(("low", "high"), [(1e15, 1e15 + 1), (0.0, 1e-318), (1.0, 1.0 + 2**-40)])
def test_no_space_is_made_where_numbers_have_no_places(low: float, high: float) -> None:
    with pytest.raises(Refused, match="so far off"):
        logged(low=low, high=high)
