"""Many seeds on the processors that there are: each run in one of a few processes, results as they come."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator, Sequence
from importlib import import_module

from scenefold.simulation.outcome import Order, Result

RUNS_PER_PROCESS = 100
"""Then a fresh one takes over, so that what a run leaves behind in the interpreter cannot pile up."""


def run_all(orders: Sequence[Order], jobs: int) -> Iterator[Result]:
    """Results in the order in which they are ready."""
    if jobs == 1 or len(orders) == 1:
        yield from map(run_one, orders)
        return
    # Processes are spawned, not forked: each is what a stranger's would be, and nothing of ours can leak into a run.
    with multiprocessing.get_context("spawn").Pool(jobs, initializer=_settle, maxtasksperchild=RUNS_PER_PROCESS) as pool:
        yield from pool.imap_unordered(run_one, orders)


def _settle() -> None:
    """What all runs of a process need is there before the first of them."""
    from scenefold.world.sim.run import settle

    import_module("scenefold.simulation.run")
    settle()


def run_one(order: Order) -> Result:
    """A run in this process."""
    from scenefold.simulation.run import run

    return run(order)
