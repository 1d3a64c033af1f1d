"""If this fails, what a file has that a scene cannot have is told by one way to render it, and kept from who renders by another."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import scenefold.client
from scenectl import still_in_tasks
from scenectl.still import ImageFiles, Phases, StillJob
from scenefold.client import ImportReport
from scenefold.render.client import StillOptions

JOB = StillJob(
    file=Path("a.glb"),
    scene_name="a",
    profile="p",
    nodes=1,
    threads=None,
    ports=None,
    options=StillOptions(),
    files=ImageFiles.beside(Path("a.exr")),
)


async def test_an_import_into_a_cluster_tells_what_was_not_carried_over(monkeypatch: pytest.MonkeyPatch) -> None:
    report = ImportReport(records=3, not_carried=("fog",))

    async def prepared(*_: object) -> Any:
        return SimpleNamespace(check_camera=lambda _: None)

    async def imported(*_: object, **_options: object) -> Any:
        return "the scene", report

    monkeypatch.setattr(scenefold.client, "prepare_import", prepared)
    cluster: Any = SimpleNamespace(calls=SimpleNamespace(world=None), scenes=SimpleNamespace(import_prepared=imported))
    scene, kept = await still_in_tasks._scene(JOB, cluster, Phases(), lambda _: None)
    ready: Any = SimpleNamespace(imported=kept)
    assert scene == "the scene"
    assert still_in_tasks._imported(JOB, ready, ()) == report.document()
    of_file: Any = SimpleNamespace(imported=None)
    assert still_in_tasks._imported(JOB, of_file, ("fog",)) == {"not_carried": ["fog"]}
