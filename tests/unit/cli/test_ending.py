"""If this fails, a scene is ended that nobody meant, or people are not told what becomes of its data."""

from __future__ import annotations

import io

import pytest

from scenectl.ending import end_text
from scenectl.program import main
from scenefold.base.ids import SceneId
from scenefold.client.ending import SceneEnd

END = SceneEnd(SceneId(7), 3)


def test_it_is_said_what_becomes_of_the_data() -> None:
    text = end_text("kitchen", END)
    assert "ended, at position 3" in text and "drops what it held" in text and "away" in text and "keys stay" in text
    assert end_text("kitchen", SceneEnd(SceneId(7), 3, was_ended=True)) == "Scene kitchen was ended before, at position 3 of its log."
    assert "its 12 records would go" in end_text("kitchen", SceneEnd(SceneId(7), None, records=12))


@pytest.mark.parametrize("more", [[], ["--json"]])
def test_without_a_terminal_it_has_to_be_said(more: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("kitchen\n"))
    assert main(["scene", "rm", "kitchen", *more]) == 2
    told = capsys.readouterr().err
    assert "cannot be brought back" in told and "--yes" in told and "--dry-run" in told


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_another_name_is_no_consent(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("yes\n"))
    assert main(["scene", "rm", "kitchen"]) == 2
    told = capsys.readouterr().err
    assert "Type its name" in told and "not the scene's name" in told and "nothing was changed" in told
