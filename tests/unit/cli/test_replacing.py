"""If this fails, a render puts its file in the place of what a scene shows, and nobody is told."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import scenefold.client
from scenectl import still, still_in_tasks
from scenectl.still import ImageFiles, Phases, StillJob, report_text
from scenefold.client import ImportReport
from scenefold.render.client import StillOptions

JOB = StillJob(
    file=Path("b.glb"),
    scene_name="kitchen",
    profile="p",
    nodes=1,
    threads=None,
    ports=None,
    options=StillOptions(),
    files=ImageFiles.beside(Path("b.exr")),
)
REPORT: dict[str, Any] = {"exr": "b.exr", "png": "b.png", "nodes": 0, "seconds": {}, "image_sha256": "ab"}


class Stored(Exception):
    """The import has begun."""


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Its scene shows something already."""

    async def prepared(*_: object) -> Any:
        return SimpleNamespace(check_camera=lambda _: None)

    async def imported(*_: object, replacing: Any = None) -> Any:
        assert replacing is not None, "nobody is told"
        replacing(SimpleNamespace(counts={"triangles": 1200}, source="a.glb"))
        raise Stored

    monkeypatch.setattr(scenefold.client, "prepare_import", prepared)
    return SimpleNamespace(calls=SimpleNamespace(world=None), scenes=SimpleNamespace(import_prepared=imported))


async def test_a_still_tells_before_it_replaces_what_a_scene_shows(
    cluster: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @asynccontextmanager
    async def there(*_: object) -> AsyncIterator[Any]:
        yield cluster, None

    monkeypatch.setattr(still, "cluster_of", there)
    with pytest.raises(Stored):
        await still.make_still(JOB, lambda _: None)
    told = "note: scene kitchen shows a.glb (1,200 triangles) already: this import replaces it.\n"
    assert capsys.readouterr().err == told
    with pytest.raises(Stored):
        await still_in_tasks._scene(JOB, cluster, Phases(), lambda _: None)
    assert capsys.readouterr().err == told


@pytest.mark.parametrize("source", ["a.glb", ""])
def test_afterwards_it_says_what_was_replaced(source: str) -> None:
    text = report_text(REPORT | {"import": ImportReport(records=3, replaced=source).document()})
    assert ("It replaces a.glb, whose records stay" in text) == bool(source)
