"""If this fails, all nodes of a machine compile the same kernels at once, or one that dies at it keeps the others from it."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.errors import LocalFault
from scenefold.base.kernel_cache import note_compiled
from scenefold.render import compiling
from scenefold.render.compiling import compile_apart


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiling, "use_kernel_cache", lambda: tmp_path)
    monkeypatch.setattr(compiling, "LOOK_S", 0.1)
    return tmp_path


class Processes:
    """What was run, and how it ends."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, codes: list[int]) -> None:
        self.codes, self.begun = codes, 0
        self.may_end = trio.Event()
        monkeypatch.setattr(trio, "run_process", self.run)

    async def run(self, command: list[str], **_: Any) -> Any:
        assert command[-1] == "scenefold.render.warm"
        self.begun += 1
        await self.may_end.wait()
        code = self.codes.pop(0)
        if not code:
            note_compiled()
        return SimpleNamespace(returncode=code, stderr=b"no memory\n")


async def test_one_compiles_and_the_others_wait_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    processes, done = Processes(monkeypatch, [0]), list[bool]()

    async def compiles() -> None:
        done.append(await compile_apart())

    with trio.fail_after(20.0):
        async with trio.open_nursery() as nursery:
            for _ in range(3):
                nursery.start_soon(compiles)
            await trio.testing.wait_all_tasks_blocked(0.02)
            assert processes.begun == 1 and not done
            processes.may_end.set()
    assert sorted(done) == [False, False, True] and processes.begun == 1
    assert not await compile_apart()


async def test_if_one_fails_the_next_tries(monkeypatch: pytest.MonkeyPatch) -> None:
    processes = Processes(monkeypatch, [1, 0])
    processes.may_end.set()
    with pytest.raises(LocalFault, match="ended with code 1: no memory"):
        await compile_apart()
    assert await compile_apart()


async def test_another_process_is_waited_for_until_it_is_gone(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    processes = Processes(monkeypatch, [0])
    processes.may_end.set()
    handle = os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with trio.move_on_after(0.3) as waited:
        await compile_apart()
    assert waited.cancelled_caught and processes.begun == 0
    os.close(handle)
    with trio.fail_after(20.0):
        assert await compile_apart()


async def test_a_lock_that_cannot_be_made_is_one_clear_error(folder: Path) -> None:
    (folder / "compiling.lock").mkdir()
    with pytest.raises(LocalFault, match="cannot write there"):
        await compile_apart()
