"""Kernels compiled in a process of their own, whose memory goes with it: to compile takes more than most budgets.

Once for all processes of a user on a machine: who comes while another one compiles waits for it.
"""

from __future__ import annotations

import fcntl
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import trio

from scenefold.base.errors import LocalFault
from scenefold.base.kernel_cache import are_compiled, kernel_folder, use_kernel_cache

WARM = "scenefold.render.warm"
LOOK_S = 0.5


async def compile_apart() -> bool:
    """Have another process compile the kernels, if that was not done yet; whether it was not. LocalFault if it cannot."""
    use_kernel_cache()
    if are_compiled():
        return False
    async with _turn():
        if are_compiled():
            return False
        done = await trio.run_process([sys.executable, "-m", WARM], capture_stdout=True, capture_stderr=True, check=False)
    if done.returncode != 0:
        what = f"the process that compiles kernels ended with code {done.returncode}"
        last = done.stderr.decode(errors="replace").strip().rsplit("\n", 1)[-1]
        where, remedy = f"python -m {WARM}", "run that by itself, on a machine with 1 GiB of memory to spare"
        raise LocalFault(f"{what}: {last}" if last else what, where=where, remedy=remedy)
    return True


@asynccontextmanager
async def _turn() -> AsyncIterator[None]:
    """While no other process compiles. The system takes the lock back from whoever dies."""
    folder = kernel_folder()
    if folder is None:
        yield
        return
    try:
        handle = os.open(folder / "compiling.lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    except OSError as problem:
        raise LocalFault(f"cannot write there: {problem.strerror}", where=str(folder), remedy="check its permissions") from problem
    try:
        while not _is_locked(handle):  # noqa: ASYNC110 - another process has it, and tells nobody when it is done
            await trio.sleep(LOOK_S)
        yield
    finally:
        os.close(handle)


def _is_locked(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as problem:
        raise LocalFault(f"cannot lock the folder of kernels: {problem.strerror}", where=str(kernel_folder())) from problem
    return True
