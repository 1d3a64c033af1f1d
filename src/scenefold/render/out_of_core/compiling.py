"""Kernels compiled in a process of their own, whose memory goes with it: to compile takes more than most budgets."""

from __future__ import annotations

import sys

import trio

from scenefold.base.errors import LocalFault
from scenefold.base.kernel_cache import are_compiled, use_kernel_cache

WARM = "scenefold.render.warm"


async def compile_apart() -> bool:
    """Have another process compile the kernels, if that was not done yet; whether it was not. LocalFault if it cannot."""
    use_kernel_cache()
    if are_compiled():
        return False
    done = await trio.run_process([sys.executable, "-m", WARM], capture_stdout=True, capture_stderr=True, check=False)
    if done.returncode != 0:
        what = f"the process that compiles kernels ended with code {done.returncode}"
        last = done.stderr.decode(errors="replace").strip().rsplit("\n", 1)[-1]
        where, remedy = f"python -m {WARM}", "run that by itself, on a machine with 1 GiB of memory to spare"
        raise LocalFault(f"{what}: {last}" if last else what, where=where, remedy=remedy)
    return True
