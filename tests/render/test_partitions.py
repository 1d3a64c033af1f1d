"""If this fails, a visual or temporal partition makes another image than a pool of nodes does, or reads what it need not."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trio

from render.painted_room import write_room
from scenefold.base.errors import DamagedData, LocalFault
from scenefold.render.image_files import image_sha256
from scenefold.render.job import RenderOptions
from scenefold.render.layers import BESIDE, Pixels, unpacked
from scenefold.render.levels import Adaptive
from scenefold.render.rehearsal.pool import Records, memory_pool
from scenefold.render.tasks import engine, rendering, runs, work
from scenefold.render.tasks.holding import RenderEnded
from scenefold.render.tasks.rendering import Workers, render_temporal, render_visual
from scenefold.render.tasks.sources import SceneFile
from scenefold.render.window import Window
from scenefold.world.real.world import offline_world

SMALL = RenderOptions(width=48, height=36, samples=8, seed=3, sky=(0.2, 0.3, 0.5))
CASES = {
    "plain": SMALL,
    "all layers": replace(SMALL, layers=BESIDE),
    "a crop": replace(SMALL, crop=Window(7, 5, 29, 17)),
    "adaptive": replace(SMALL, samples=64, adaptive=Adaptive(0.2, 4), layers=("samples", "variance")),
    "independent dice": replace(SMALL, sampling=replace(SMALL.sampling, sampler="independent")),
}
HERE = Workers(threads=2)


class InOneThread:
    """An engine that needs no extra: one task after the other, the last one first."""

    name, workers = "inline", 3

    def __init__(self, _threads: int, end: Callable[[], None]) -> None:
        self._end = end

    def map(self, tasks: Sequence[Callable[[], Any]], take: Callable[[Any], None]) -> bool:
        for task in reversed(tasks):
            take(task())
        return True

    def stop(self) -> None:
        pass

    def close(self) -> None:
        self._end()


@pytest.fixture(autouse=True)
def without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "ThreadsEngine", InOneThread)


@pytest.fixture(autouse=True)
def small_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that an image of few pixels is cut into many runs, also across its samples."""
    monkeypatch.setattr(runs, "ROWS_LEAST", 100)
    monkeypatch.setattr(runs, "PATHS_MOST", 500)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_room(tmp_path_factory.mktemp("room"))


def quiet(*_: object) -> None:
    """Nobody looks at the progress."""


async def by_pool(records: Records, options: RenderOptions) -> dict[str, Pixels]:
    async with memory_pool(offline_world(), records, 3) as pool:
        image, state = await pool.render(11, options)
    assert sum(node["rays_sent"] for node in state["nodes"]) > 0
    return unpacked(image, options.layers, options.window.width, options.window.height)


def equal(one: dict[str, Pixels], other: dict[str, Pixels]) -> bool:
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("case", CASES)
async def test_the_three_ways_give_the_same_bits(case: str, room: Records, file: Path) -> None:
    options = CASES[case]
    spatial = await by_pool(room, options)
    visual = await render_visual(SceneFile(file), options, HERE, quiet)
    frames: list[dict[str, Pixels]] = []
    report = await render_temporal([SceneFile(file)], options, HERE, quiet, lambda _index, layers, _left: frames.append(layers))
    assert equal(visual.layers, spatial)
    assert equal(frames[0], spatial)
    assert (
        visual.report["paths"]
        == report["paths"]
        == int(visual.layers.get("samples", np.full(options.window.pixels, options.samples)).sum())
    )
    assert case != "adaptive" or visual.report["paths"] < options.window.pixels * options.samples
    assert visual.report["render_nodes"][0]["tasks"] > 4


@pytest.mark.skipif(importlib.util.find_spec("dask") is None, reason="dask is not installed: it is an optional extra")
@pytest.mark.parametrize("case", ["plain", "adaptive"])
async def test_threads_that_dask_schedules_do_too(case: str, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alone = await render_visual(SceneFile(file), CASES[case], HERE, quiet)
    monkeypatch.setattr(rendering, "ThreadsEngine", engine.ThreadsEngine)
    with trio.fail_after(60):
        together = await render_visual(SceneFile(file), CASES[case], HERE, quiet)
    assert equal(together.layers, alone.layers) and together.report["engine"] == "threads"


async def test_a_process_reads_the_scene_once_and_lets_it_go(file: Path) -> None:
    made = await render_visual(SceneFile(file), SMALL, HERE, quiet)
    (node,) = made.report["render_nodes"]
    frames = await render_temporal([SceneFile(file)] * 3, SMALL, HERE, quiet, quiet)
    (other,) = frames["render_nodes"]
    assert node["bytes_read"] > 0 and other["bytes_read"] == 3 * node["bytes_read"]
    assert node["processor_seconds"] > 0 and node["memory_most"] > 1 << 20
    assert work._held._places == {}


async def test_another_seed_gives_another_image(file: Path) -> None:
    one, other = [(await render_visual(SceneFile(file), replace(SMALL, seed=seed), HERE, quiet)).layers["beauty"] for seed in (3, 4)]
    assert image_sha256(one) != image_sha256(other)


async def test_a_scene_that_has_changed_is_refused(file: Path) -> None:
    with pytest.raises(BaseExceptionGroup) as group:
        await render_visual(SceneFile(file), SMALL, HERE, quiet, content=bytes(32))
    assert isinstance(group.value.exceptions[0], DamagedData)


@pytest.mark.parametrize(
    ("options", "words"),
    [(replace(SMALL, camera="attic"), "no camera 'attic'"), (replace(SMALL, samples=0), "samples is 0")],
)
async def test_what_cannot_be_rendered_is_one_clear_error(options: RenderOptions, words: str, file: Path) -> None:
    try:
        await render_visual(SceneFile(file), options, HERE, quiet)
    except* LocalFault as group:
        found = str(group.exceptions[0])
    assert words in found


async def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(BaseExceptionGroup) as group:
        await render_temporal([SceneFile(tmp_path / "no.glb")], SMALL, HERE, quiet, quiet)
    (fault,) = group.value.exceptions
    while isinstance(fault, BaseExceptionGroup):
        (fault,) = fault.exceptions
    assert isinstance(fault, LocalFault) and "no.glb" in fault.where


async def test_tasks_end_between_two_samples(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever is stopped has a task come to its end before long."""
    names = iter(["first"])
    monkeypatch.setattr(rendering, "_named", lambda: next(names))

    def stops(_engine: InOneThread, tasks: Sequence[Callable[[], Any]], take: Callable[[Any], None]) -> bool:
        take(tasks[0]())
        work.end_render("first")
        with pytest.raises(RenderEnded):
            tasks[1]()
        return False

    monkeypatch.setattr(InOneThread, "map", stops)
    with trio.move_on_after(0.2) as scope:
        await render_visual(SceneFile(file), SMALL, HERE, quiet)
    assert scope.cancelled_caught
