"""If this fails, a setting that is empty means the folder where one happens to be, or is an error that names a value nobody gave."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.program import main


@pytest.fixture(autouse=True)
def in_a_profile(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The current folder is one, and nothing else is."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("SCENEFOLD_PROFILE", raising=False)
    assert main(["cluster", "init", str(tmp_path / "here"), "--nodes", "127.0.0.2"]) == 0
    monkeypatch.chdir(tmp_path / "here")
    capsys.readouterr()


def test_an_empty_variable_is_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("SCENEFOLD_PROFILE", "")
    monkeypatch.setenv("SCENEFOLD_NODES", "")
    assert main(["key", "show"]) == 1
    assert f"there is no cluster profile ({tmp_path}/config/scenefold/default)" in capsys.readouterr().err
    assert main(["render", "still", "nowhere.glb"]) == 1
    assert "there is no such scene file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "verb", [("key", "show"), ("cluster", "status"), ("cluster", "join", "127.0.0.2"), ("key", "import", "cluster.toml")]
)
def test_an_empty_name_is_wrong_usage(verb: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*verb, "-p", ""]) == 2
    remedy = "name a folder, or leave it out for the default one"
    assert capsys.readouterr().err == f"error: the name of the profile is empty (--profile): {remedy}\n"
