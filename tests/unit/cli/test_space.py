"""If this fails, positions below 0 cannot be given, or a box is read as another one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from scenectl import space
from scenectl.copies import copies_cell, lacking_text, plan_text
from scenectl.positions import Box, Position
from scenectl.program import main
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.copies import CopiesPlan
from scenefold.scene.log import Affine, Layouts, LoggedSpace


def test_boxes_and_positions_are_read_as_they_stand() -> None:
    assert Box.parse("-1,0,1e3:2,0.5,inf") == Box((-1.0, 0.0, 1000.0), (2.0, 0.5, float("inf")))
    assert str(Box.parse("0,0:1,2.5")) == "0,0:1,2.5"
    assert Position.parse("-0.5") == Position((-0.5,))
    malformed = (
        "",
        "1,,2",
        "1,2:3,4:5,6",
        "1 2",
        ",".join("0" * 9),
        "nan",
        "inf",
        "0,2:1,1",
        "0,nan:1,1",
        "0:1,1",
        "0,0:" + ",".join("1" * 17),
    )
    for text in malformed:
        with pytest.raises(ValueError):
            Box.parse(text) if ":" in text else Position.parse(text)


@pytest.mark.parametrize(
    "arguments",
    [
        ["translate", "hall", "--by", "-1,-2.5,0"],
        ["query", "hall", "--box", "-1,-2,-3:1,2,3"],
        ["create", "hall", "--box", "-1,-2,-3:1,2,3", "--render-output"],
    ],
)
def test_numbers_below_0_may_be_given(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    asked: list[Any] = []

    async def stop(profile: str | None, scene: str, work: Any) -> Any:
        asked.append((profile, scene, work))
        raise RuntimeError("far enough")

    monkeypatch.setattr(space, "_in_cluster", stop)
    assert main(["space", *arguments, "--scene", "kitchen", "--profile", "studio"]) == 1
    assert "far enough" in capsys.readouterr().err
    assert asked[0][:2] == ("studio", "kitchen")


def test_a_plan_of_copies_says_what_would_come_and_what_would_go() -> None:
    hall = LoggedSpace(SpaceId(11), "hall", 1, "hilbert", (0.0,), (1.0,), Affine.identity(1), copies=3, copies_min=2)
    more = plan_text(CopiesPlan(hall, 5, 2, ("hall copy 3", "hall copy 4"), 1000, 4))
    assert "would make 1,000 copies of 1,000 records" in more and "hall copy 3, hall copy 4" in more and "There are 4 nodes" in more
    fewer = plan_text(CopiesPlan(hall, 1, 1, (), 1000, 4))
    assert "2,000 copies of 1,000 records would go" in fewer and "Shadows" not in fewer and "nodes" not in fewer
    one = plan_text(CopiesPlan(hall, 4, 2, (), 1, 4))
    assert "Nodes would make 1 copy of 1 record, in the background." in one
    assert "nothing would change" in plan_text(CopiesPlan(hall, 3, 2, (), 1000, 4))


def test_a_space_that_asks_for_more_copies_than_it_has_shadows_for_is_told() -> None:
    """Early programs noted the number, and made no shadows."""
    hall = LoggedSpace(SpaceId(11), "hall", 1, "hilbert", (0.0,), (1.0,), Affine.identity(1), copies=3, copies_min=2)
    shade, spare = (
        replace(hall, id=SpaceId(number), parent=hall.id, offset=Location.from_number(number), copies=1, copies_min=1)
        for number in (12, 13)
    )
    few, enough = (Layouts.of(space.public() for space in spaces) for spaces in ([hall, shade], [replace(hall, copies=2), shade, spare]))
    assert copies_cell(hall, few) == "3, at least 2 (shadows for 2)"
    assert "space 11 (can have 2). `scenectl space copies SPACE NUMBER --scene kitchen`" in lacking_text("kitchen", few.lacking())
    assert copies_cell(replace(hall, copies=2), enough) == "2, at least 2" and lacking_text("kitchen", enough.lacking()) == ""
    assert [copies_cell(space, enough) for space in (shade, spare)] == ["holds some", "holds none"]
    assert copies_cell(replace(hall, copies=1), Layouts.of([replace(hall, copies=1).public()])) == "1"
