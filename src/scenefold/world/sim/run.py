"""Runs a Trio program in virtual time, the same way every time for one seed.

What a run depends on, and how it is held still:

- the order in which Trio runs tasks: shuffled, from the seed (the switch and the dice that Trio has for Hypothesis)
- time: virtual, and passing only between events (time.py)
- threads: there are none; work for threads runs inline (workers.py)
- randomness: `Dice` by seed and name (entropy.py)
- the collector of garbage: runs at fixed steps
"""

from __future__ import annotations

import gc
import hashlib
import warnings
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, TypeVarTuple

import trio

from scenefold.world.sim.rounds import SchedulingDice, spare_rounds, tasks_by
from scenefold.world.sim.time import SimulationStuck, VirtualTime

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

VIRTUAL_S_MAX = 1e6
STEPS_MAX = 200_000_000
WALL_S_MAX = 600.0
_UNAWAITED = "was never awaited"


def run_simulated(
    seed: int,
    main: Callable[[*Ts], Awaitable[T]],
    *args: *Ts,
    virtual_s_max: float = VIRTUAL_S_MAX,
    steps_max: int = STEPS_MAX,
    wall_s_max: float = WALL_S_MAX,
) -> T:
    """`trio.run(main, *args)` in virtual time. SimulationStuck on a deadlock or a limit, else what `main` does.

    `steps_max` bounds rounds of Trio's loop, `wall_s_max` real seconds: a program that runs and runs ends with a list of
    its tasks. (A loop that never awaits cannot be stopped from here.)
    """
    clock = VirtualTime(virtual_s_max=virtual_s_max, steps_max=steps_max, wall_s_max=wall_s_max)
    return run_on(clock, seed, main, *args)


def run_on(clock: VirtualTime, seed: int, main: Callable[[*Ts], Awaitable[T]], *args: *Ts, **trio_options: Any) -> T:
    """The same on a clock that was made before."""
    with deterministic(seed), _awaited_everything():
        return _unstuck(clock, main, args, trio_options)


def _unstuck(clock: VirtualTime, main: Callable[..., Awaitable[T]], args: tuple[Any, ...], trio_options: dict[str, Any]) -> T:
    result: list[T] = []

    async def bounded() -> None:
        spare_rounds()
        with clock.main:
            result.append(await main(*args))

    try:
        trio.run(bounded, clock=clock, **trio_options)
    except BaseException as error:
        if clock.failure is None:
            raise
        if isinstance(error, trio.TrioInternalError) and isinstance(error.__cause__, SimulationStuck):
            raise error.__cause__ from clock.failure
        raise clock.failure from error
    if clock.failure is not None:
        raise clock.failure
    assert result, "the main task was cancelled by itself"
    return result[0]


_settled: list[bool] = []


def settle() -> None:
    """For a process that does nothing but simulate: modules, and whatever else is there now, no collection looks through again."""
    _settled.append(True)
    gc.collect()
    gc.freeze()


@contextmanager
def deterministic(seed: int) -> Iterator[None]:
    """Trio runs tasks in an order that depends on the seed alone; the collector keeps to the steps of the clock."""
    collecting = gc.isenabled()
    gc.collect()
    # What is there already (modules, what the test has made) is not looked through again at every collection of the run.
    gc.freeze()
    gc.disable()
    try:
        with tasks_by(SchedulingDice(hashlib.sha256(b"scheduling %d" % seed).digest())):
            yield
    finally:
        if not _settled:
            gc.unfreeze()
        if collecting:
            gc.enable()


@contextmanager
def _awaited_everything() -> Iterator[None]:
    """A coroutine that nobody awaited is a bug of the simulated code: an error, not a warning on the side."""
    forgotten: list[str] = []
    with warnings.catch_warnings():
        warnings.filterwarnings("always", message=f".*{_UNAWAITED}", category=RuntimeWarning)
        show = warnings.showwarning

        def note(message: Warning | str, category: type[Warning], filename: str, lineno: int, *more: Any, **named: Any) -> None:
            if issubclass(category, RuntimeWarning) and _UNAWAITED in str(message):
                forgotten.append(f"{filename}:{lineno}: {message}")
            else:
                show(message, category, filename, lineno, *more, **named)

        warnings.showwarning = note
        yield
    if forgotten:
        raise SimulationStuck("coroutines were made and never awaited:\n  " + "\n  ".join(forgotten))
