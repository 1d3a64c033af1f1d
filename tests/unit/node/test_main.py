"""If this fails, a node or a command goes on without the collector of garbage, which rests only while it imports."""

from __future__ import annotations

import gc
from types import ModuleType

import pytest

import scenectl.__main__
import scenectl.program
import scenefold.node.__main__
import scenefold.node.program


@pytest.mark.parametrize(
    ("begun", "program"),
    [(scenefold.node.__main__, scenefold.node.program), (scenectl.__main__, scenectl.program)],
    ids=["node", "scenectl"],
)
def test_what_is_imported_is_set_apart_and_garbage_is_collected_after_that(
    begun: ModuleType, program: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(begun, "leave_at", lambda *_, **__: None)
    monkeypatch.setattr(program, "main", lambda *_: (gc.isenabled(), gc.get_freeze_count() > 10_000))
    before = gc.get_freeze_count()
    try:
        assert begun.main() == (True, True)
    finally:
        if not before:
            gc.unfreeze()
