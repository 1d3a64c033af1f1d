"""If this fails, the tables of specs/25-consensus.md, or the drawings of the documentation, are not what the code does."""

from __future__ import annotations

import draw_consensus
import pytest


def test_the_tables_of_the_specification_are_those_of_the_code() -> None:
    text = draw_consensus.SPECIFICATION.read_text(encoding="utf-8")
    assert draw_consensus.filled(text) == text, "run tools/draw_consensus.py"


def test_the_drawings_are_up_to_date() -> None:
    assert draw_consensus.PAGE.read_text(encoding="utf-8") == draw_consensus.page(), "run tools/draw_consensus.py"


@pytest.mark.parametrize("name", draw_consensus.TABLES)
def test_every_guard_and_action_is_used_and_says_what_it_means(name: str) -> None:
    rows, guards, actions = draw_consensus.TABLES[name]
    assert {guard for row in rows for guard in row.given} == set(guards)
    assert {action for row in rows for action in row.do} == set(actions)
    assert all(function.__doc__ for function in (*guards.values(), *actions.values()))
