"""Rounds of Trio's loop at the price of what a simulation needs of them.

A run has some thirty thousand rounds. In each of them Trio asks the kernel for readable sockets, of which there are none, looks
some ten times whether an instrument is installed, through a dictionary written in Python, and shuffles what is mostly a single
task. And a third of all rounds is there only because a task that need not wait gives way to others at a checkpoint. Trio's
scheduler may let such a task go on ("for increased efficiency", says its documentation of `checkpoint`), and here it often does,
by dice: so tasks meet in more orders than if all of them always gave way.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import trio
from trio._core import _run

from scenefold.world.sim.time import calls_wait

ROUNDS_BETWEEN_POLLS = 256
"""The kernel is asked every so many rounds all the same: an interrupt from the keyboard comes that way."""
GIVES_WAY = 0.3
"""The part of checkpoints at which a task that need not wait gives way."""


class _Polls:
    """Stands before Trio's own manager: asks the kernel only if something was put into the queue for other threads' calls."""

    def __init__(self, manager: Any, entries: Any) -> None:
        self._manager = manager
        self._entries = entries
        self._rounds = 0

    def get_events(self, timeout: float) -> Any:
        self._rounds += 1
        if timeout or calls_wait(self._entries) or self._rounds % ROUNDS_BETWEEN_POLLS == 0:
            return self._manager.get_events(timeout)
        return ()

    def process_events(self, events: Any) -> None:
        if events:
            self._manager.process_events(events)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._manager, name)


class _NoInstruments(dict[str, Any]):
    """Empty, and says so in C."""


def spare_rounds() -> None:
    """For the run of Trio that this task is in."""
    runner: Any = trio._core._run.GLOBAL_RUN_CONTEXT.runner
    if not any(runner.instruments.values()):
        runner.instruments = _NoInstruments()
    runner.io_manager = _Polls(runner.io_manager, runner.entry_queue)


class _DeadlineChange:
    """What Trio does when a change of a scope is over that may concern its deadline: the queue of deadlines is told.

    Trio writes it as a generator, of which each scope makes two: as an object it costs a third.
    """

    __slots__ = ("_scope",)

    def __init__(self, scope: Any) -> None:
        self._scope = scope

    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        scope = self._scope
        before = scope._registered_deadline
        now = math.inf if scope._cancel_status is None or scope._cancel_called else scope._deadline
        if before != now:
            scope._registered_deadline = now
            deadlines = trio._core._run.GLOBAL_RUN_CONTEXT.runner.deadlines
            if before != math.inf:
                deadlines.remove(before, scope)
            if now != math.inf:
                deadlines.add(now, scope)


def _change_of_deadline(scope: Any) -> _DeadlineChange:
    """A function, since only those become methods."""
    return _DeadlineChange(scope)


class SchedulingDice(random.Random):
    """Trio's dice. Shuffles the few tasks of a round in a third of the time."""

    def shuffle(self, x: Any) -> None:
        draw = self.random
        for last in range(len(x) - 1, 0, -1):
            other = int(draw() * (last + 1))
            x[last], x[other] = x[other], x[last]


@contextmanager
def tasks_by(dice: SchedulingDice) -> Iterator[None]:
    """Within this context these dice say in which order tasks run, and where they give way."""
    run: Any = _run
    lowlevel: Any = trio.lowlevel
    deterministic, before, give_way = run._ALLOW_DETERMINISTIC_SCHEDULING, run._r, run.cancel_shielded_checkpoint
    draw, current_task = dice.random, trio.lowlevel.current_task
    scopes: Any = trio.CancelScope
    change_deadline = scopes._might_change_registered_deadline

    async def perhaps_give_way() -> None:
        # A task's first one is kept: libraries move a new task into another context that way.
        if draw() < GIVES_WAY or not current_task()._schedule_points:
            await give_way()

    run._ALLOW_DETERMINISTIC_SCHEDULING, run._r = True, dice
    run.cancel_shielded_checkpoint = lowlevel.cancel_shielded_checkpoint = perhaps_give_way
    scopes._might_change_registered_deadline = _change_of_deadline
    try:
        yield
    finally:
        run._ALLOW_DETERMINISTIC_SCHEDULING, run._r = deterministic, before
        run.cancel_shielded_checkpoint = lowlevel.cancel_shielded_checkpoint = give_way
        scopes._might_change_registered_deadline = change_deadline
