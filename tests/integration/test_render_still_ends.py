"""If this fails, a render that is stopped, or that loses a node, leaves processes or files behind, hangs, or says nothing."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from integration.scenectl_process import await_ends, await_progress, children, command, environment, running, scenectl
from loopback import addresses, ports_option

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
END_S = 30.0
"""From what ends a render to its last word: much less than any of its requests may take."""
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"

pytestmark = pytest.mark.timeout(300)


@dataclass(frozen=True)
class Rendering:
    """A `render still` that would take hours."""

    process: subprocess.Popen[str]
    nodes: dict[str, int]
    """Process ids by address, if the nodes are its own."""

    def next_words(self) -> str:
        """The next thing that it says; no progress, no empty lines."""
        assert self.process.stderr is not None
        while not (line := self.process.stderr.readline()).strip() or line.startswith("render:"):
            assert line, "it has ended"
        return line

    def last_words(self) -> list[str]:
        """What it said since, when it has ended; no progress, no empty lines."""
        _, said = self.process.communicate(timeout=END_S)
        assert "Traceback" not in said
        return [line for line in said.splitlines() if line and not line.startswith(("render:", "prepare:"))]


@contextmanager
def rendering(folder: Path, *arguments: str | Path, profile: str | None = None) -> Iterator[Rendering]:
    """A render under way, in whose `folder` there is a room and, in tmp/, its temporary files."""
    (folder / "tmp").mkdir()
    more = ["--sky", "0.5,0.6,0.7", "--size", "48x32", "--samples", "1000000", "-o", folder / "o.exr"]
    words = command("render", "still", *arguments, *more)
    env = environment(profile, TMPDIR=str(folder / "tmp"))
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env, text=True) as process:
        try:
            await_progress(process)
            yield Rendering(process, children(process.pid))
        finally:
            process.kill()


def own_nodes(folder: Path, count: int = 3) -> list[str | Path]:
    """Arguments for a render with nodes of its own."""
    (folder / "room.obj").write_text(ROOM)
    return [folder / "room.obj", "--nodes", str(count), "--ports", ports_option(*addresses(count)), "--threads", "1"]


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*"))


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    with rendering(tmp_path, *own_nodes(tmp_path)) as render:
        assert set(render.nodes) == set(addresses(3))
        render.process.send_signal(signal.SIGINT)
        assert render.last_words() == ["error: interrupted: the same command may be given again"]
        assert render.process.returncode == 130
        await_ends(render.nodes.values(), 0.0)
    assert left(tmp_path) == ["room.obj", "tmp"]


def test_nodes_end_with_a_client_that_is_killed(tmp_path: Path) -> None:
    with rendering(tmp_path, *own_nodes(tmp_path)) as render:
        assert set(render.nodes) == set(addresses(3))
        render.process.kill()
        await_ends(render.nodes.values(), END_S)
    assert "o.exr" not in left(tmp_path)


@pytest.mark.long
def test_nodes_that_are_killed_are_named_and_none_of_them_ends_the_render(tmp_path: Path) -> None:
    """Which one organises it is drawn: all are killed, until it was its turn."""
    with rendering(tmp_path, *own_nodes(tmp_path)) as render:
        for victim, process in sorted(render.nodes.items()):
            os.kill(process, signal.SIGKILL)
            line = render.next_words()
            if not line.startswith(f"note: node {victim} is lost"):
                break
        assert line.startswith("note: the node that organises the render is lost") and f"({victim}): it is begun anew" in line
        assert render.next_words().startswith(f"note: node {victim} ended unexpectedly (SIGKILL)")
        render.process.send_signal(signal.SIGINT)
        assert render.last_words() == ["error: interrupted: the same command may be given again"]
        await_ends([*render.nodes.values(), *children(render.process.pid).values()], 0.0)
    assert left(tmp_path) == ["room.obj", "tmp"]


def test_a_node_of_a_running_cluster_that_is_killed_is_named(tmp_path: Path) -> None:
    """No supervisor here: the nodes that are left must notice by themselves, and stay of use."""
    ours = addresses(3)
    made = scenectl(
        "cluster", "init", tmp_path / "studio", "--nodes", ",".join(ours), "--trust-all", "--ports", ports_option(*ours), "--json"
    )
    profile = made.json["profile"]
    (tmp_path / "room.obj").write_text(ROOM)

    def node(address: str) -> list[str | Path]:
        return ["node", "run", "--address", address, "--data", tmp_path / address, "--threads", "1", "--log-level", "error", "--json"]

    with running(*node(ours[0]), profile=profile), running(*node(ours[2]), profile=profile):
        with running(*node(ours[1]), profile=profile) as (victim, _):
            assert scenectl("scene", "import", tmp_path / "room.obj", profile=profile).code == 0
            folder = tmp_path / "client"
            folder.mkdir()
            with rendering(folder, "--scene", "room", profile=profile) as render:
                victim.kill()
                line = render.next_words()
                if line != f"note: node {ours[1]} is lost: the others take its part of the scene over, and trace again what only it had\n":
                    assert "the node that organises the render is lost" in line and f"it is begun anew without {ours[1]}\n" in line
                render.process.send_signal(signal.SIGINT)
                assert render.last_words() == ["error: interrupted: the same command may be given again"]
            assert left(folder) == ["tmp"]
        assert scenectl("cluster", "status", profile=profile).code == 5, "two of three nodes live on"
