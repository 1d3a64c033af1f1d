"""If this fails, commands of other tests run as they would for nobody else: those are forked, and not started."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from integration.scenectl_process import scenectl, scenectl_from_nothing
from integration.warm_scenectl import warm
from loopback import ports_option


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a cluster that does not run."""
    where = tmp_path_factory.mktemp("one") / "profile"
    made = scenectl("cluster", "init", where, "--nodes", "127.0.0.2", "--ports", ports_option("127.0.0.2"))
    assert made.code == 0, made.err
    return where


@pytest.mark.parametrize(
    "arguments",
    [
        ["--version"],
        ["scene", "create"],
        ["data", "put", "files", "a1", "-", "--scene", "attic", "--json"],
        ["cluster", "status", "--profile", "/nowhere"],
        ["render", "still", "/nowhere/room.obj", "-o", "o.exr", "--json"],
    ],
)
def test_a_command_says_the_same_as_one_from_nothing(arguments: list[str], profile: Path) -> None:
    assert scenectl(*arguments, profile=profile, stdin=b"words") == scenectl_from_nothing(*arguments, profile=profile, stdin=b"words")


def test_one_command_leaves_nothing_to_the_next(tmp_path: Path) -> None:
    missing = tmp_path / "missing"
    assert str(missing) in scenectl("cluster", "status", profile=missing).error
    assert str(missing) not in scenectl("cluster", "status", HOME=str(tmp_path), XDG_CONFIG_HOME=str(tmp_path)).err


def test_a_command_that_takes_too_long_is_killed(profile: Path, tmp_path: Path) -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        scenectl("node", "run", "--address", "127.0.0.2", "--data", tmp_path / "data", profile=profile, limit_s=1)
    assert scenectl("--version").code == 0


def test_it_has_no_threads_and_imports_nothing_that_has() -> None:
    pid = warm()._process.pid
    assert scenectl("--version").code == 0
    assert os.listdir(f"/proc/{pid}/task") == [str(pid)]  # noqa: PTH208 - numbers, not paths
    maps = Path(f"/proc/{pid}/maps").read_text()
    assert "llvmlite" not in maps and "embree" not in maps
