"""If this fails, a translated or scaled space shows its records in the wrong place, or a box query misses some of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.scene.log import Affine, LoggedSpace, SpaceFault
from scenefold.scene.log.space import Step

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
