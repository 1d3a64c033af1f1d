"""If this fails, a file from somewhere makes the client hang, take the machine's memory, or leave half a scene in a store.

Uses ../shared/scenes where that exists. All of malformed/ goes through `prepare_import`, which is all that stands between a
file and a store, in processes that may take 2 GiB; some files go all the way into nodes.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from integration.scenectl_process import environment, running, scenectl
from loopback import addresses, ports_option
from scenefold.scene.importers import READERS

SCENES = Path(__file__).parents[2].parent / "shared" / "scenes"
MEMORY_BYTES = 2 << 30
FILE_S = 20
"""For one file, a client's start included; the slowest takes about one second."""
PROCESSES = 2

CLIENT = """
import json, signal, sys, trio
from pathlib import Path
from scenefold.base.errors import LocalFault
from scenefold.client import prepare_import
from scenefold.world import offline_world

async def one(path):
    prepared = await prepare_import(offline_world(), Path(path), lambda state: None)
    return sum(1 for _ in prepared.plan.items())

for path in sys.stdin:
    path = path.rstrip("\\n")
    signal.alarm(int(sys.argv[1]))  # a reader that hangs ends the process, whose last word is the file before
    try:
        said = ["imported", trio.run(one, path)]
    except LocalFault as fault:
        said = ["refused", str(fault)]
    print(json.dumps([path, *said]), flush=True)
"""

pytestmark = pytest.mark.skipif(not SCENES.is_dir(), reason="the shared scenes are not here")


def limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))


def said_of(paths: list[Path]) -> dict[str, list[object]]:
    """What one client said of each file."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", CLIENT, str(FILE_S)],
        input="".join(f"{path}\n" for path in paths),
        capture_output=True,
        text=True,
        timeout=100,
        env=environment(None),
        preexec_fn=limit_memory,
    )
    answers = {row[0]: row[1:] for row in map(json.loads, done.stdout.splitlines())}
    ended_at = next((path for path in paths if str(path) not in answers), None)
    assert done.returncode == 0, f"{ended_at} ended the client ({done.returncode}): {done.stderr[-2_000:]}"
    return answers


def test_every_malformed_file_is_read_or_refused_in_time_and_memory() -> None:
    kinds = {*READERS, ".off"}
    paths = sorted(path for path in (SCENES / "malformed").rglob("*") if path.suffix.lower() in kinds)
    assert len(paths) > 150
    with ThreadPoolExecutor(PROCESSES) as clients:
        halves = list(clients.map(said_of, [paths[number::PROCESSES] for number in range(PROCESSES)]))
    answers = {path: answer for half in halves for path, answer in half.items()}
    assert len(answers) == len(paths)
    for path, (outcome, said) in answers.items():
        if outcome == "refused":
            assert Path(path).name in str(said) and "\n" not in str(said) and "): " in str(said), said
        else:
            assert int(str(said)) > 0


@pytest.fixture(scope="module")
def profile(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("store")
    with running("node", "local", "2", "--folder", folder, "--ports", ports_option(*addresses(2)), "--json") as (_, ready):
        yield ready["profile"]


VALID = {
    "BoxTextured/BoxTextured.glb": 12,
    "SimpleSparseAccessor/SimpleSparseAccessor.gltf": 12,
    "MeshPrimitiveModes/MeshPrimitiveModes.gltf": 16,  # 6 as a list, 4 as a strip, 6 as a fan
    "spot/spot.obj": 5_856,
    "CesiumMan/CesiumMan.glb": 4_672,
}
REFUSED = ["malformed/assimp/invalid/empty.obj", "malformed/assimp/invalid/OutOfMemory.off"]


@pytest.mark.parametrize("name", VALID)
def test_a_file_from_somewhere_lands_in_a_store(name: str, profile: str) -> None:
    done = scenectl("scene", "import", SCENES / name, "--json", profile=profile)
    assert done.code == 0, done.err
    info = scenectl("scene", "info", Path(name).stem, "--json", profile=profile).json
    assert info["counts"]["triangles"] == VALID[name]
    assert info["content_sha256"] == done.json["content_sha256"]


def test_a_refused_file_leaves_no_scene(profile: str) -> None:
    before = scenectl("scene", "list", "--json", profile=profile).json
    files = [path for name in REFUSED if (path := SCENES / name).is_file()]
    assert files
    for path in files:
        assert path.name in scenectl("scene", "import", path, profile=profile).refusal(1)
    assert scenectl("scene", "list", "--json", profile=profile).json == before
