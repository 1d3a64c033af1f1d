"""If this fails, tasks go on when nobody wants them, an engine's trouble ends in a traceback, or a scene's secrets leave by an open line."""

from __future__ import annotations

import builtins
import importlib.util
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
import trio

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.render.tasks.engine import ThreadsEngine, check_installed, checked_address, done_by
from scenefold.render.tasks.holding import RenderEnded
from scenefold.world import offline_world

needs_dask = pytest.mark.skipif(importlib.util.find_spec("dask") is None, reason="dask is not installed: it is an optional extra")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "tls://10.0.0.5:8786", "tcp://localhost:1", "tcp://[::1]:8786"])
def test_what_may_carry_a_scene_of_a_cluster(address: str) -> None:
    assert checked_address(address, is_secret=True) == address


@pytest.mark.parametrize("address", ["tcp://10.0.0.5:8786", "tcp://render.example:8786", "tcp://localhost.example:8786"])
def test_an_open_line_to_elsewhere_is_for_files_alone(address: str) -> None:
    with pytest.raises(UsageFault, match=r"keys.*tls://"):
        checked_address(address, is_secret=True)
    assert checked_address(address, is_secret=False, is_network_trusted=True) == address


def test_nor_for_those_unless_the_network_is_trusted() -> None:
    """Who answers in an engine's place can run any code here."""
    with pytest.raises(UsageFault, match=r"run any code in this process.*tls://.*--trust-network"):
        checked_address("tcp://10.0.0.5:8786", is_secret=False)
    with pytest.raises(UsageFault, match="keys"):
        checked_address("tcp://10.0.0.5:8786", is_secret=True, is_network_trusted=True)
    assert checked_address("tcp://127.0.0.1:8786", is_secret=False) == "tcp://127.0.0.1:8786"


@pytest.mark.parametrize(
    "address", ["", "threads", "10.0.0.5:8786", "http://a:1", "tcp://", "tcp://a", "tcp://a:x", "tcp://:8786", "tcp://[::1"]
)
def test_what_is_no_address(address: str) -> None:
    with pytest.raises(UsageFault, match="no address of a Dask scheduler"):
        checked_address(address, is_secret=False)


def test_without_the_extra_one_error_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = builtins.__import__

    def without(name: str, *args: Any, **more: Any) -> Any:
        if name.partition(".")[0] == "dask":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return plain(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(LocalFault, match=r"needs the package dask.*pip install 'scenefold\[dask\]'"):
        ThreadsEngine(1, nothing)
    with pytest.raises(LocalFault, match="needs the package dask"):
        check_installed(None)


def nothing() -> None:
    pass


def numbered(number: int) -> int:
    return number


@needs_dask
async def test_all_tasks_are_done_once() -> None:
    taken: list[int] = []
    await done_by(ThreadsEngine(3, nothing), [partial(numbered, number) for number in range(50)], taken.append, offline_world().workers)
    assert sorted(taken) == list(range(50))


@needs_dask
async def test_an_engine_does_one_lot_after_the_other() -> None:
    """As the levels of an adaptive render are done."""
    ended = threading.Event()
    engine, taken = ThreadsEngine(2, ended.set), list[int]()
    with trio.fail_after(20):
        for first in (0, 10):
            await done_by(engine, [partial(numbered, first + number) for number in range(10)], taken.append, offline_world().workers)
    assert sorted(taken) == list(range(20)) and not ended.is_set()


@needs_dask
def test_its_threads_are_the_same_ones_for_all_lots() -> None:
    """Work is counted by thread, and a lot is but a level."""
    engine, threads = ThreadsEngine(1, nothing), list[int]()
    try:
        for _ in range(3):
            assert engine.map([threading.get_ident] * 2, threads.append)
    finally:
        engine.close()
    assert len(threads) == 6 and len(set(threads)) == 1
    assert not [thread for thread in threading.enumerate() if thread.ident in threads], "none is left behind"


@needs_dask
async def test_the_error_of_a_task_is_ours_and_the_others_end() -> None:
    ended = threading.Event()

    def waits() -> int:
        assert ended.wait(20)
        raise RenderEnded

    def fails() -> int:
        raise LocalFault("the file is none", where="a.glb", remedy="give another")

    with pytest.raises(BaseExceptionGroup) as group:
        await done_by(ThreadsEngine(2, ended.set), [waits, fails], lambda _: None, offline_world().workers)
    (fault,) = group.value.exceptions
    assert isinstance(fault, LocalFault) and fault.where == "a.glb"


@needs_dask
async def test_a_cancelled_render_leaves_no_task_behind() -> None:
    begun, ended, left = threading.Event(), threading.Event(), threading.Event()

    def waits() -> int:
        begun.set()
        assert ended.wait(20)
        left.set()
        raise RenderEnded

    taken: list[int] = []
    with trio.CancelScope() as scope:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(done_by, ThreadsEngine(1, ended.set), [waits, waits], taken.append, offline_world().workers)
            await trio.to_thread.run_sync(partial(begun.wait, 20))
            scope.cancel()
    assert scope.cancelled_caught and left.is_set() and taken == []


@needs_dask
def test_a_result_that_cannot_be_used_ends_the_others() -> None:
    ended = threading.Event()

    def take(_: int) -> None:
        raise LocalFault("cannot write there", where="x.exr", remedy="choose another folder")

    tasks: list[Callable[[], int]] = [partial(numbered, number) for number in range(4)]
    with pytest.raises(LocalFault, match="cannot write there"):
        ThreadsEngine(2, ended.set).map(tasks, take)
    assert ended.is_set()
