"""If this fails, commands of other tests run as they would for nobody else: those are forked, and not started."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
import trio

from integration.scenectl_process import scenectl, scenectl_from_nothing
from integration.warm_nodes import open_warm_process
from integration.warm_scenectl import warm
from loopback import free_ports, ports_option
from scenefold.node import process
from scenefold.node.local import local_cluster


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


async def test_a_node_that_was_forked_says_the_same_and_ends_like_one_from_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words: list[str] = []
    for how in (open_warm_process, trio.lowlevel.open_process):
        monkeypatch.setattr(process, "open_process", how)
        with pytest.raises(process.NodeEnded) as caught:
            await process.NodeProcess("127.0.0.2", ["--profile", "/nowhere", "--address", "127.0.0.2"], tmp_path / "log").run()
        words.append(str(caught.value))
    assert words[0] == words[1] and "/nowhere" in words[0]


async def test_a_node_that_was_forked_dies_and_is_known_by_its_own_number(tmp_path: Path) -> None:
    async with local_cluster(1, tmp_path, ports=free_ports(["127.0.0.2"])) as nodes:
        pid = nodes.pid("127.0.0.2")
        assert pid is not None and os.getpgid(pid) == pid, "Ctrl-C is not for it"
        await nodes.kill("127.0.0.2")
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
        nodes.start("127.0.0.2")
        await nodes.wait()
        await nodes.stop("127.0.0.2")
        assert nodes.pid("127.0.0.2") != pid
