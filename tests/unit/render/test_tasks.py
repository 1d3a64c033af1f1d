"""If this fails, tasks compile more than they must, go on reading a scene that nobody wants, or count the writing of images as rendering."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trio

from scenefold.base.errors import LocalFault
from scenefold.render.film_rows import row_bytes
from scenefold.render.job import RenderOptions
from scenefold.render.sum_columns import SumColumns
from scenefold.render.tasks import handed_on, rendering, tracing, whole_scene
from scenefold.render.tasks.figures import Figures
from scenefold.render.tasks.holding import RenderEnded
from scenefold.render.tasks.rendering import Workers, render_temporal
from scenefold.render.tasks.runs import Run
from scenefold.render.tasks.sources import SceneFile
from scenefold.render.tasks.work import MadeFrame, Seen, TracedRun, Use

OPTIONS = RenderOptions(width=4, height=4, samples=1)
SEEN = Seen("embree", b"content", (np.zeros(3), np.ones(3)), 0.0, ())
END_S = 20.0


def use() -> Use:
    return Use(node="a:1", thread=1, processor_from_s=0.0, processor_to_s=1.0, memory_most=1000, paths=16, rays=16, casts=16)


class Frames:
    """An engine that makes frames of nothing."""

    name, workers = "frames", 2

    def __init__(self, _threads: int, _end: Callable[[], None]) -> None:
        pass

    def map(self, tasks: Sequence[object], take: Callable[[Any], None]) -> bool:
        for index in range(len(tasks)):
            take((index, MadeFrame({"beauty": np.zeros((4, 4, 3), np.float32)}, SEEN, use())))
        return True

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


async def compiled() -> bool:
    return False


def quiet(*_: object) -> None:
    """Nobody looks at the progress."""


async def test_writing_frames_is_no_part_of_their_rendering(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    for module in (rendering, handed_on):
        monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    monkeypatch.setattr(rendering, "ThreadsEngine", Frames)
    monkeypatch.setattr(rendering, "compile_apart", compiled)
    all_made, written = threading.Event(), list[int]()

    def made(index: int, *_: object) -> None:
        # The room is for all of them, so that none waits.
        assert all_made.wait(END_S)
        written.append(index)
        clock[0] += 100.0

    class Two(Frames):
        def map(self, tasks: Sequence[object], take: Callable[[Any], None]) -> bool:
            clock[0] = 7.0
            is_done = super().map(tasks, take)
            all_made.set()
            return is_done

    monkeypatch.setattr(rendering, "ThreadsEngine", Two)
    report = await render_temporal([SceneFile.__new__(SceneFile)] * 2, OPTIONS, Workers(), quiet, made)
    assert report["render_seconds"] == {"prepare": 0.0, "render": 7.0}
    assert written == [0, 1] and clock[0] == 207.0


async def test_a_frame_that_cannot_be_written_ends_the_render(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "ThreadsEngine", Frames)
    monkeypatch.setattr(rendering, "compile_apart", compiled)

    def made(*_: object) -> None:
        raise LocalFault("cannot write there", where="x.exr", remedy="choose another folder")

    with trio.fail_after(END_S), pytest.RaisesGroup(LocalFault, flatten_subgroups=True):
        await render_temporal([SceneFile.__new__(SceneFile)] * 9, OPTIONS, Workers(), quiet, made)


async def test_threads_find_kernels_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else each would wait for them in its first task."""
    done: list[str] = []

    async def compiles() -> bool:
        done.append("compiled")
        return True

    class Told(Frames):
        def map(self, tasks: Sequence[object], take: Callable[[Any], None]) -> bool:
            done.append("tasks")
            return super().map(tasks, take)

    monkeypatch.setattr(rendering, "ThreadsEngine", Told)
    monkeypatch.setattr(rendering, "compile_apart", compiles)
    await render_temporal([SceneFile.__new__(SceneFile)], OPTIONS, Workers(), quiet, quiet)
    assert done == ["compiled", "tasks"]


@dataclass
class Endless:
    """A source whose reading never ends."""

    begun: threading.Event = field(default_factory=threading.Event)

    @asynccontextmanager
    async def opened(self, _workers: object) -> AsyncIterator[Any]:
        self.begun.set()
        await trio.sleep_forever()
        yield


def test_reading_a_scene_ends_with_its_render(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_scene, "compile_apart", compiled)
    source = Endless()

    def check() -> None:
        if source.begun.is_set():
            raise RenderEnded("a")

    with pytest.raises(RenderEnded):
        whole_scene.open_whole(source, OPTIONS, check)  # type: ignore[arg-type]


async def test_what_was_made_all_the_same_is_not_lost() -> None:
    """It holds memory that somebody has to free."""
    ended = trio.Event()

    def check() -> None:
        ended.set()
        raise RenderEnded("a")

    async def computes() -> str:
        with trio.CancelScope(shield=True):
            await ended.wait()
            return "a scene"

    assert await whole_scene._wanted(computes, check) == "a scene"


def test_one_thread_of_a_process_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    times, ended = [0], list[str]()
    all_there = threading.Barrier(4)

    async def compiles() -> bool:
        times[0] += 1
        return True

    monkeypatch.setattr(whole_scene, "compile_apart", compiles)
    monkeypatch.setattr(whole_scene, "_compiled", threading.Event())

    class Missing:
        @asynccontextmanager
        async def opened(self, _workers: object) -> AsyncIterator[Any]:
            raise LocalFault("there is no such file", where="a.glb", remedy="check the path")
            yield

    def opens() -> None:
        all_there.wait(END_S)
        with pytest.raises(LocalFault) as error:
            whole_scene.open_whole(Missing(), OPTIONS, quiet)  # type: ignore[arg-type]
        ended.append(error.value.where)

    threads = [threading.Thread(target=opens, daemon=True) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(END_S)
    assert ended == ["a.glb"] * 4 and times == [1]


def test_kernels_get_no_tables_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those would be another kind, for which numba compiles them once more."""
    kinds: list[bool] = []
    columns = SumColumns()
    job = SimpleNamespace(window=SimpleNamespace(pixels=8), columns=columns)
    tracer = SimpleNamespace(generate=lambda *_: {})
    monkeypatch.setattr(
        tracing, "add_pass", lambda *tables: kinds.extend(one.flags.writeable for one in tables if isinstance(one, np.ndarray))
    )
    for goes_on in (b"", b"\1" * 8):
        rows = tracing.rows_of(tracer, job, Run(0, 8, 0, 1), goes_on, use(), lambda: None)  # type: ignore[arg-type]
    film = SimpleNamespace(rows=rows, add_rows=lambda _, words: kinds.append(words.flags.writeable))
    take = rendering._Rows(film, Figures(), quiet, 1)  # type: ignore[arg-type]
    take(TracedRun(Run(0, 8, 0, 1), bytes(8 * row_bytes(columns)), SEEN, use()))
    assert len(kinds) > 3 and all(kinds)
