"""If this fails, an option is ignored in silence, or a setting for clusters of one's own is in the way of a profile."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.program import main

VERBS = {
    "render still a.obj": ["--nodes", "--threads", "--ports"],
    "render still --scene kitchen": ["--nodes", "--threads", "--ports"],
    "bench store": ["--nodes", "--ports"],
}
VALUES = {"--nodes": "7", "--threads": "2", "--ports": "2000,2001"}
VARIABLES = {"--nodes": "SCENEFOLD_NODES", "--threads": "SCENEFOLD_THREADS", "--ports": "SCENEFOLD_PORTS"}
CASES = [(verb, option) for verb, options in VERBS.items() for option in options]


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for variable in (*VARIABLES.values(), "SCENEFOLD_PROFILE"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")


@pytest.mark.parametrize(("verb", "option"), CASES)
def test_what_is_of_a_cluster_of_ones_own_is_refused_beside_a_profile(
    verb: str, option: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*verb.split(), option, VALUES[option], "--profile", "studio"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: {option} is of a cluster") and said.count("\n") == 1
    assert f"leave out {option} " in said and "leave out --profile" in said
    monkeypatch.setenv("SCENEFOLD_PROFILE", "studio")
    assert main([*verb.split(), option, VALUES[option]]) == 2
    assert "unset SCENEFOLD_PROFILE" in capsys.readouterr().err


@pytest.mark.parametrize(("verb", "option"), CASES)
def test_a_variable_that_is_set_for_clusters_of_ones_own_is_not_in_the_way(
    verb: str, option: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLES[option], VALUES[option])
    assert main([*verb.split(), "--profile", "/nowhere"]) == 1
    assert "no cluster profile" in capsys.readouterr().err
