"""If this fails, a page of `scenectl --help` lists a command without a word about what it does."""

from __future__ import annotations

import re
from collections.abc import Iterator

import cyclopts
import pytest
from rich.console import Console

from scenectl.program import GROUPS, main

ROW = re.compile(r"│ (?P<name>[a-z][a-z-]*)(?P<about>.*)│")
COMMANDS = "─ Commands ─"


def page(capsys: pytest.CaptureFixture[str], *path: str) -> str:
    assert main([*path, "--help"]) == 0
    return capsys.readouterr().out


def listed(text: str) -> dict[str, str]:
    """The commands of a page, with what it says of each."""
    box = text.partition(COMMANDS)[2].partition("╰")[0]
    return {row["name"]: row["about"].strip() for row in map(ROW.match, box.splitlines()) if row is not None}


def walked(capsys: pytest.CaptureFixture[str], *path: str) -> Iterator[tuple[str, str]]:
    """All commands below, each with its line on the page that lists it."""
    for name, about in listed(page(capsys, *path)).items():
        yield " ".join((*path, name)), about
        yield from walked(capsys, *path, name)


def test_every_command_of_every_group_has_a_line_of_help(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cyclopts.App, "console", property(lambda _app: Console(width=400)))
    found = dict(walked(capsys))
    assert found.keys() >= GROUPS.keys() | {"node verify", "node repair", "node blacklist list", "node upkeep show", "space copies"}
    assert [command for command, about in found.items() if len(about.split()) < 2] == []
