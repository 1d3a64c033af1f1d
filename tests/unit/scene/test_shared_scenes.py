"""If these failed, a stranger's file could crash or fill a machine. Uses ../shared/scenes where that exists."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from scenefold.scene.importers import READERS

SCENES = Path(__file__).parents[3].parent / "shared" / "scenes"
MEMORY_BYTES = 2 << 30
PROGRAM = """
import json, sys
from scenefold.base.errors import LocalFault
from scenefold.scene.importers import plan_import, read_scene
for path in sys.stdin.read().splitlines():
    try:
        plan = plan_import(read_scene(path))
        records = sum(1 for _ in plan.items())
        print(json.dumps([path, "imported", plan.triangles, records]))
    except LocalFault as fault:
        print(json.dumps([path, "refused", str(fault), fault.remedy]))
"""

pytestmark = pytest.mark.skipif(not SCENES.is_dir(), reason="the shared scenes are not here")


def imported(paths: list[Path]) -> dict[str, list[object]]:
    """What one process, of at most 2 GiB, said about each file."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM],
        input="\n".join(map(str, paths)),
        capture_output=True,
        text=True,
        timeout=100,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES)),
    )
    assert done.returncode == 0, done.stderr[-2_000:]
    return {row[0]: row[1:] for row in map(json.loads, done.stdout.splitlines())}


def test_every_malformed_file_is_imported_or_refused_in_one_line() -> None:
    kinds = {*READERS, ".off"}
    paths = sorted(path for path in (SCENES / "malformed").rglob("*") if path.suffix.lower() in kinds)
    assert len(paths) > 150
    answers = imported(paths)
    assert len(answers) == len(paths)
    for path, (outcome, said, remedy) in answers.items():
        assert outcome == "imported" or ("\n" not in str(said) and len(str(said)) < 500 and remedy), path
    good = {Path(path).name for path, answer in answers.items() if answer[0] == "imported"}
    assert {"box_without_lineending.obj", "cube_binary_header_with_RN_newline.ply", "concave_polygon.obj"} <= good
    assert not good & {"IndexOutOfRange.gltf", "BoxWithInfinites.glb", "RecursiveNodes.gltf", "OutOfMemory.off"}


@pytest.mark.parametrize(
    ("name", "triangles"),
    [
        ("bmw27/bmw27.glb", 1_670_956),
        ("barcelona_pavilion/barcelona_pavilion.glb", 112_358),
        ("stanford_bunny/stanford-bunny.obj", 69_451),
        ("SimpleInstancing/SimpleInstancing.glb", 12),
        ("SimpleSparseAccessor/SimpleSparseAccessor.gltf", 12),
        ("TextureTransformTest/TextureTransformTest.gltf", 24),
    ],
)
def test_real_scenes_import_within_two_gibibytes(name: str, triangles: int) -> None:
    (answer,) = imported([SCENES / name]).values()
    assert answer[:2] == ["imported", triangles]
