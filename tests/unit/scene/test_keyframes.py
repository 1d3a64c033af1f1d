"""If these failed, what moves would stand elsewhere than its file says between two keyframes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.scene.importers.keyframes import Interpolation, Numbers, Track, between_turns, unit

SHARES = st.floats(0, 1)
QUATERNIONS = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda one: sum(value * value for value in one) > 1e-2).map(unit)


def track(times: list[float], values: object, kind: Interpolation, *, turns: bool = False) -> Track:
    rows = np.array(values, np.float64)
    if kind is not Interpolation.CUBICSPLINE:
        rows = np.repeat(rows[:, None], 3, axis=1)
    return Track(np.array(times), rows, kind, turns)


@pytest.mark.parametrize("kind", list(Interpolation))
def test_outside_its_keyframes_a_value_stands_still_and_at_each_it_is_what_the_file_says(kind: Interpolation) -> None:
    values = [[1.0, 2.0], [3.0, -4.0], [5.0, 0.5]]
    told = values if kind is not Interpolation.CUBICSPLINE else [[[9.0, 9.0], value, [-9.0, 9.0]] for value in values]
    moving = track([1.0, 2.0, 4.0], told, kind)
    for time, value in ((0.0, values[0]), (1.0, values[0]), (2.0, values[1]), (4.0, values[2]), (99.0, values[2])):
        assert moving.at(time) == pytest.approx(value, abs=1e-12)


def test_steps_hold_and_lines_are_straight() -> None:
    values = [[0.0], [10.0]]
    assert track([1.0, 3.0], values, Interpolation.STEP).at(2.999) == (0.0,)
    assert track([1.0, 3.0], values, Interpolation.LINEAR).at(1.5) == (2.5,)


@given(SHARES, st.floats(0.01, 100))
def test_a_spline_is_the_cubic_with_these_tangents(share: float, step: float) -> None:
    """A cubic x³ - 2x² + 3x - 1 is its own spline: values and slopes at both ends determine it."""

    def value(x: float) -> float:
        return x**3 - 2 * x * x + 3 * x - 1

    def slope(x: float) -> float:
        return 3 * x * x - 4 * x + 3

    told = [[[0.0], [value(0.0)], [slope(0.0)]], [[slope(step)], [value(step)], [0.0]]]
    found = track([0.0, step], told, Interpolation.CUBICSPLINE).at(share * step)
    assert found[0] == pytest.approx(value(share * step), rel=1e-9, abs=1e-9 * (1 + abs(value(step))))


@given(QUATERNIONS, QUATERNIONS, SHARES)
def test_turns_go_the_shorter_way_at_an_even_pace(first: Numbers, second: Numbers, share: float) -> None:
    cosine = sum(a * b for a, b in zip(first, second, strict=True))
    near = second if cosine >= 0 else tuple(-value for value in second)
    angle = math.acos(min(abs(cosine), 1.0))
    found = between_turns(first, second, share)
    assert sum(value * value for value in found) == pytest.approx(1.0, abs=1e-12)
    if angle < 1e-5:
        wanted: Numbers = tuple(a + (b - a) * share for a, b in zip(first, near, strict=True))
    else:
        weights = math.sin((1 - share) * angle) / math.sin(angle), math.sin(share * angle) / math.sin(angle)
        wanted = tuple(a * weights[0] + b * weights[1] for a, b in zip(first, near, strict=True))
    assert found == pytest.approx(wanted, abs=1e-7 if angle < 1e-3 else 1e-10)


def test_two_keyframes_at_one_time_are_a_jump() -> None:
    moving = track([0.0, 1.0, 1.0, 2.0], [[0.0], [1.0], [5.0], [6.0]], Interpolation.LINEAR)
    assert moving.at(0.5) == (0.5,) and moving.at(1.0) == (5.0,) and moving.at(1.5) == (5.5,)


def test_a_spline_of_turns_that_passes_through_nothing_stays_where_it_was() -> None:
    told = [[[0.0] * 4, [0.0, 0.0, 0.0, 1.0], [0.0] * 4], [[0.0] * 4, [0.0, 0.0, 0.0, -1.0], [0.0] * 4]]
    assert track([0.0, 1.0], told, Interpolation.CUBICSPLINE, turns=True).at(0.5) == (0.0, 0.0, 0.0, 1.0)
