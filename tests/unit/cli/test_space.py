"""If this fails, positions below 0 cannot be given, or a box is read as another one."""

from __future__ import annotations

from typing import Any

import pytest

from scenectl import space
from scenectl.positions import Box, Position
from scenectl.program import main


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

    monkeypatch.setattr(space, "_in_scene", stop)
    assert main(["space", *arguments, "--scene", "kitchen", "--profile", "studio"]) == 1
    assert "far enough" in capsys.readouterr().err
    assert asked[0][:2] == ("studio", "kitchen")
