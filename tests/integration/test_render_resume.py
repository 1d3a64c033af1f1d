"""If this fails, Ctrl-C, or its sudden end, costs all that was rendered, or what goes on from it is another image."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest

from integration.scenectl_process import await_ends, children, command, environment, scenectl
from loopback import addresses, ports_option

KERNELS_S = 240.0
"""The first render after a change of the kernels compiles them."""
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"
IMAGE = ["--sky", "0.5,0.6,0.7", "--size", "96x72", "--samples", "256", "--threads", "1", "--json"]

pytestmark = pytest.mark.timeout(360)


def render(folder: Path, nodes: int, *more: str | Path) -> list[str | Path]:
    ports = ports_option(*addresses(nodes))
    return ["render", "still", folder / "room.obj", "--nodes", str(nodes), "--ports", ports, "-o", folder / "o.exr", *IMAGE, *more]


def interrupted(folder: Path, kept: Path, sign: signal.Signals) -> int:
    """A render that is ended as soon as something of it is kept; its exit code."""
    words = command(*render(folder, 2, "--resume", kept))
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment(None)) as process:
        try:
            until = time.monotonic() + KERNELS_S
            while not kept.exists():
                assert process.poll() is None and time.monotonic() < until
                time.sleep(0.01)
            nodes = children(process.pid)
            process.send_signal(sign)
            code = process.wait(60)
            await_ends(nodes.values(), 30.0)
            return code
        finally:
            process.kill()


@pytest.mark.parametrize("sign", [pytest.param(signal.SIGINT, marks=pytest.mark.long), signal.SIGKILL])
def test_the_same_command_goes_on_to_the_same_image(tmp_path: Path, sign: signal.Signals) -> None:
    (tmp_path / "room.obj").write_text(ROOM)
    kept = tmp_path / "room.kept"
    assert interrupted(tmp_path, kept, sign) != 0
    assert not (tmp_path / "o.exr").exists()
    refused = scenectl(*render(tmp_path, 1, "--resume", kept, "--seed", "5"), limit_s=KERNELS_S)
    assert "the kept render is of another seed" in refused.refusal(1)
    (tmp_path / "other.obj").write_text(ROOM.replace("v 4 3 0", "v 4 2 0"))
    other = [tmp_path / "other.obj" if word == tmp_path / "room.obj" else word for word in render(tmp_path, 1, "--resume", kept)]
    refused = scenectl(*other, limit_s=KERNELS_S)
    assert "the scene is not the one that the kept render is of" in refused.error and refused.code != 0
    resumed = scenectl(*render(tmp_path, 1, "--resume", kept), limit_s=KERNELS_S)
    assert resumed.code == 0, resumed.err
    assert 0 < resumed.json["paths_before"] < resumed.json["paths"] == 96 * 72 * 256
    assert not kept.exists(), "it is of no use any more"
    undisturbed = scenectl(*render(tmp_path, 1), limit_s=KERNELS_S)
    assert undisturbed.code == 0 and undisturbed.json["paths_before"] == 0
    assert resumed.json["image_sha256"] == undisturbed.json["image_sha256"]
