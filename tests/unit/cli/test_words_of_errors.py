"""If this fails, an error sends people to the wrong place: it names another option, file or cause than the one at fault."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenectl.program import main
from scenefold.base.errors import LocalFault
from scenefold.base.names import SPACE_NAME_RULE
from scenefold.render.out_of_core import still
from scenefold.world import leftovers
from scenefold.world.profile import ClusterProfile

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n"


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("square.obj").write_text(SQUARE)


def line(capsys: pytest.CaptureFixture[str], code: int, *arguments: str) -> str:
    assert main(arguments) == code
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(said) == 1
    return said[0]


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("--exposure", "nan"), "--exposure: a number is expected, not 'nan'"),
        (("--scale", "little"), "--scale: a number is expected, not 'little'"),
        (("--exposure", "inf"), "Must be <= 64"),
        (("--layers", "all,none"), "'all' stands alone"),
        (("--layers", "albedo,None"), "'None' stands alone"),
        (("--camera", ""), "a camera's name has 1 to "),
    ],
)
def test_an_option_of_an_image(arguments: tuple[str, ...], what: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert what in line(capsys, 2, "render", "still", "square.obj", *arguments)


def test_a_setting_that_is_no_number(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SCENEFOLD_SEED_WAIT", "nan")
    assert "a number is expected, not 'nan'" in line(capsys, 2, "node", "run", "--address", "127.0.0.2")


def test_a_space_is_named_in_bytes(capsys: pytest.CaptureFixture[str]) -> None:
    assert "64 bytes of UTF-8" in SPACE_NAME_RULE
    assert SPACE_NAME_RULE in line(capsys, 2, "space", "create", "é" * 33, "--scene", "kitchen")


def test_a_file_of_keys_is_looked_at_before_a_passphrase_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert "cannot read the file: No such file or directory (nowhere)" in line(capsys, 1, "key", "import", "nowhere")
    assert "the file holds no keys (square.obj)" in line(capsys, 1, "key", "import", "square.obj")


@pytest.mark.parametrize(
    ("problem", "remedy"),
    [
        (FileNotFoundError(2, "No such file or directory"), "choose another folder"),
        (PermissionError(13, "Denied"), "check its permissions"),
    ],
)
def test_a_folder_that_cannot_be_made(problem: OSError, remedy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def failing(_: Path) -> Any:
        raise problem

    monkeypatch.setattr(leftovers, "new_folder", failing)
    with pytest.raises(LocalFault, match=remedy):
        ClusterProfile.create(tmp_path / "studio", "studio", ["127.0.0.2"])


def test_an_environment_map_is_called_so(capsys: pytest.CaptureFixture[str]) -> None:
    said = line(capsys, 1, "render", "still", "square.obj", "--environment", "nope.hdr")
    assert said == "error: the file does not exist (nope.hdr): give the path of an environment map"


@pytest.mark.parametrize(("budget", "shown"), [(1024, "1,024 bytes"), (5 << 20, "5 MiB")])
def test_a_budget_is_named_as_it_is(budget: int, shown: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(still, "beside_trees", lambda *_: 0)
    monkeypatch.setattr(still, "camera_of", lambda *_: None)
    monkeypatch.setattr(still, "cells_within", lambda *_: SimpleNamespace(largest=np.int64(9 << 20)))
    asked: Any = SimpleNamespace(memory=budget, threads=1)
    nothing: Any = None
    with pytest.raises(LocalFault, match=f"a budget of {shown} is too small"):
        still._plan(nothing, nothing, asked)
