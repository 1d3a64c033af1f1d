"""If this fails, what a cluster of real nodes holds cannot be taken out of it, or does not come back as it was."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from integration.scenectl_process import command, environment, running, scenectl
from loopback import ports_option

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")
HOW_TO = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "archive-a-scene.md"
SIDE = 40
"""Squares along a side of what is imported: some atoms full of triangles."""


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Three nodes with one scene: imported content, and a space of the user's that was moved."""
    folder = tmp_path_factory.mktemp("trial")
    corners = [f"v {x} {y} {(x * y) % 3}" for y in range(SIDE + 1) for x in range(SIDE + 1)]
    starts = [y * (SIDE + 1) + x + 1 for y in range(SIDE) for x in range(SIDE)]
    (folder / "grid.obj").write_text("\n".join([*corners, *(f"f {at} {at + 1} {at + SIDE + 2} {at + SIDE + 1}" for at in starts)]))
    with running("node", "local", "3", "--folder", folder / "nodes", "--ports", ports_option(*ADDRESSES), "--json") as (_, ready):
        profile = ready["profile"]

        def done(*arguments: str | Path, stdin: bytes = b"") -> None:
            ended = scenectl(*arguments, profile=profile, stdin=stdin)
            assert ended.code == 0, ended.err

        done("scene", "import", folder / "grid.obj", "--scene", "kitchen")
        done("space", "create", "hall", "--box", "0:16", "--scene", "kitchen")
        done("data", "put", "hall", "4", "-", "--scene", "kitchen", stdin=b"\x00before")
        done("space", "translate", "hall", "--by", "0.1", "--scene", "kitchen")
        done("data", "put", "hall", "8", "-", "--scene", "kitchen", stdin=b"")
        done("data", "put", "files", "9", "-", "--scene", "kitchen", stdin=b"gone")
        done("data", "delete", "files", "9", "--scene", "kitchen")
        yield profile


def exported(profile: str, scene: str, file: Path) -> Any:
    done = scenectl("scene", "export", scene, file, "--json", profile=profile)
    assert done.code == 0, done.err
    return done.json


def records_of(file: Path) -> dict[str, bytes]:
    with tarfile.open(file, "r:") as tar:
        return {told.name: tar.extractfile(told).read() for told in tar if told.name.startswith("spaces/")}  # type: ignore[union-attr]


def test_a_scene_is_taken_out_read_with_tar_and_brought_back(profile: str, tmp_path: Path) -> None:
    file, again = tmp_path / "kitchen.tar", tmp_path / "again.tar"
    counted = scenectl("scene", "export", "kitchen", file, "--dry-run", "--json", profile=profile).json
    assert not file.exists()
    told = exported(profile, "kitchen", file)
    assert (told["listed"], counted["listed"]) == (told["records"] + 1, told["records"] + 1), "one was deleted"
    assert told["spaces"]["hall"] == 2 and told["spaces"]["geometry"] > 1
    (tmp_path / "k").mkdir()
    subprocess.run(["tar", "xf", file, "-C", tmp_path / "k"], check=True)
    lines = [json.loads(line) for part in sorted((tmp_path / "k" / "index").iterdir()) for line in part.read_text().splitlines()]
    sums = "".join(f"{line['sha256']}  {line['file']}\n" for line in lines)
    subprocess.run(["sha256sum", "--check", "--quiet"], input=sums.encode(), cwd=tmp_path / "k", check=True)
    [code] = re.findall(r"```python\n(.*?)```", HOW_TO.read_text(encoding="utf-8"), re.DOTALL)
    page: dict[str, Any] = {}
    exec(code, page)  # as a reader of the page would
    assert len(page["triangles"](file)) == 2 * SIDE * SIDE
    done = scenectl("scene", "import-archive", file, "--scene", "pantry", "--json", profile=profile)
    assert (done.code, done.json["records"], done.json["reused"]) == (0, told["records"], 0), done.err
    assert exported(profile, "pantry", again)["bytes"] == told["bytes"]
    assert records_of(again) == records_of(file) and len(records_of(file)) == told["records"]
    infos = [scenectl("scene", "info", scene, "--json", profile=profile).json for scene in ("kitchen", "pantry")]
    assert infos[0]["content_sha256"] == infos[1]["content_sha256"]
    halls = [scenectl("space", "query", "hall", "--scene", scene, "--json", profile=profile).json for scene in ("kitchen", "pantry")]
    assert halls[0]["records"] == halls[1]["records"] and len(halls[0]["records"]) == 2
    refused = scenectl("scene", "export", "kitchen", file, profile=profile)
    assert "there is a file already" in refused.refusal(1)
    refused = scenectl("scene", "import-archive", file, profile=profile)
    assert "exists already" in refused.refusal(1)


def test_an_import_that_was_killed_goes_on(profile: str, tmp_path: Path) -> None:
    file = tmp_path / "kitchen.tar"
    told = exported(profile, "kitchen", file)
    arguments = ("scene", "import-archive", file, "--scene", "larder")
    slow = command(*arguments, "--rate", "0.02")
    with subprocess.Popen(slow, stderr=subprocess.PIPE, env=environment(profile)) as process:
        assert process.stderr is not None
        said = next((line for line in process.stderr if line.startswith(b"restore: ")), b"")
        process.kill()
    assert said, "it ended before it was killed"
    assert scenectl("scene", "info", "larder", "--json", profile=profile).json["has_content"] is False, "it shows nothing yet"
    with subprocess.Popen([*slow, "--resume"], stderr=subprocess.PIPE, env=environment(profile)) as process:
        assert process.stderr is not None
        assert next((line for line in process.stderr if line.startswith(b"restore: ")), b"")
        process.send_signal(signal.SIGINT)
        assert b"the same command with --resume goes on" in process.stderr.read()
    done = scenectl(*arguments, "--resume", "--json", profile=profile)
    assert done.code == 0, done.err
    assert done.json["records"] == told["records"] and 0 < done.json["reused"] < told["records"]
    assert scenectl("scene", "info", "larder", "--json", profile=profile).json["has_content"] is True


def test_what_is_no_archive_is_said_and_makes_nothing(profile: str, tmp_path: Path) -> None:
    file = tmp_path / "kitchen.tar"
    exported(profile, "kitchen", file)
    assert "It is whole." in scenectl("scene", "import-archive", file, "--dry-run", profile=profile).out.decode()
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])
    for more in ((), ("--dry-run",)):
        refused = scenectl("scene", "import-archive", file, "--scene", "cellar", *more, profile=profile)
        assert "a damaged one" in refused.refusal(1)
    file.write_bytes(b"no tar")
    assert "it is no tar" in scenectl("scene", "import-archive", file, profile=profile).refusal(1)
    assert "cellar" not in scenectl("scene", "list", profile=profile).out.decode()
