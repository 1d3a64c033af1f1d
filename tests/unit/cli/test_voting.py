"""If this fails, scenectl says that voters may be lost although others are away already."""

from __future__ import annotations

import json
from typing import Any

import pytest

from scenectl import running
from scenectl.program import main
from scenectl.voting import council_text
from scenefold.base.ids import node_id_of
from scenefold.client.voters import Council

A, B, C = (node_id_of(f"127.0.0.{number}") for number in (2, 3, 4))
THREE = "Voters: 127.0.0.2, 127.0.0.3, 127.0.0.4"


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (Council([A]), "Voters: 127.0.0.2; none of them may be lost."),
        (Council([A, B, C]), f"{THREE}; 1 of them may be lost."),
        (Council([A, B, C], [B]), f"{THREE}; none of them may be lost."),
        (Council([A, B, C], [], [C]), f"{THREE}; 127.0.0.4 does not answer, and none of the others may be lost."),
        (Council([A, B, C], [], [B, C]), f"{THREE}; 127.0.0.3, 127.0.0.4 do not answer: too few are left to decide anything. Start those."),
    ],
)
def test_how_many_more_may_be_lost_is_said_in_a_sentence(found: Council, text: str) -> None:
    assert council_text(found) == text


def test_who_does_not_answer_is_in_the_json_form(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def run(_work: Any) -> Council:
        return Council([A, B, C], [], [C])

    monkeypatch.setattr(running, "run", run)
    assert main(["cluster", "voters", "--json", "--profile", "studio"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "voters": ["127.0.0.2", "127.0.0.3", "127.0.0.4"],
        "may_be_lost": 0,
        "preparing": [],
        "silent": ["127.0.0.4"],
    }
