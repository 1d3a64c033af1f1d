"""If this fails, a slip in a call of the Python API ends a program with Python's own words, or goes into a scene's log for good."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.client.new_space import new_space
from scenefold.client.steps import checked_factor, checked_offset
from scenefold.scene.log import Affine, LoggedSpace, SceneLog
from scenefold.wire import Batch, CreateSpace

HUGE = 10**400
"""A whole number that is no float."""
NO_NUMBERS: tuple[Any, ...] = (HUGE, -HUGE, "a", "1", b"1", None, [1.0], {}, 1j, Ellipsis)
HALL = SpaceId(11)


@pytest.mark.parametrize(
    ("box", "options"),
    [
        *[(([0.0], [value]), {}) for value in NO_NUMBERS],
        *[(([value], [1.0]), {}) for value in NO_NUMBERS],
        *[(box, {}) for box in (([0.0],), (), ([0], [1], [2]), 5, "ab", (1, 2), (None, None), ([], []), "a")],
        *[(None, {"dimensions": value}) for value in (2.5, 2.0, True, "3", [3], HUGE, -1, float("nan"))],
        *[(None, {name: value}) for name in ("copies", "copies_min") for value in (1.5, True, "1", HUGE, [], float("inf"))],
        *[(None, {"space_id": value}) for value in (1.5, True, "1", [])],
        *[(None, {"parent": value}) for value in (1.5, True, [], b"x")],
        *[(None, {"parent": 3, "offset": value}) for value in (b"x", "x", 3, "x" * 20, FIRST)],
        *[(None, {"curve": value}) for value in ([], 3, b"hilbert", {})],
        *[(None, {name: value}) for name in ("node_managed", "render_output") for value in (1, "no", [])],
    ],
    ids=lambda value: str(value)[:40],
)
def test_what_no_space_can_be_is_a_usage_fault(box: Any, options: Any) -> None:
    with pytest.raises(UsageFault):
        new_space("hall", box, **options)


@pytest.mark.parametrize("name", [5, None, b"hall", ["hall"]])
def test_a_name_is_a_text(name: Any) -> None:
    with pytest.raises(UsageFault):
        new_space(name)


def test_numbers_of_other_libraries_are_numbers() -> None:
    box = (np.zeros(2), np.array([1, 2]))
    batch = new_space("hall", box, dimensions=np.int64(2), copies=np.uint8(2), space_id=np.int32(30))(SceneLog())  # type: ignore[arg-type]
    assert isinstance(batch, Batch)
    made, shadow = batch.entries
    assert isinstance(made, CreateSpace) and isinstance(shadow, CreateSpace)
    assert (made.low, made.high, made.dimensions, made.copies, made.copies_min, made.space) == ((0.0, 0.0), (1.0, 2.0), 2, 2, 2, 30)
    assert {type(value) for value in (made.dimensions, made.copies, made.copies_min, made.space, shadow.space)} == {int}
    assert (shadow.parent, shadow.offset) == (30, Location(b"\x80" + bytes(19)))
    assert checked_offset(np.array([1, 2]), HALL) == (1.0, 2.0) and checked_factor(np.float32(0.5), HALL) == 0.5


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: str(value)[:40])
def test_what_is_no_number_moves_no_space(value: Any) -> None:
    for offset in (value, [value], (0.0, value)):
        if offset not in ([1.0], {}):
            with pytest.raises(LocalFault, match="finite numbers"):
                checked_offset(offset, HALL)
    with pytest.raises(LocalFault, match="finite factor"):
        checked_factor(value, HALL)


@pytest.mark.parametrize("value", [value for value in NO_NUMBERS if value not in ("1", b"1")], ids=lambda value: str(value)[:40])
def test_what_is_no_number_lies_nowhere(value: Any) -> None:
    hall = LoggedSpace(HALL, "hall", 3, "hilbert", (0.0,) * 3, (1.0,) * 3, Affine.identity(3))
    for points in (value, [value], [[value] * 3]):
        with pytest.raises(LocalFault, match="space hall"):
            hall.locations_of(points)
        with pytest.raises(LocalFault, match="space hall"):
            hall.fast_forward(points, 1)
    for corner in (value, [value], [value] * 3):
        with pytest.raises(LocalFault, match="space hall"):
            hall.box_arcs(corner, [1.0] * 3, 16)
        with pytest.raises(LocalFault, match="space hall"):
            hall.box_arcs([0.0] * 3, corner, 16)
