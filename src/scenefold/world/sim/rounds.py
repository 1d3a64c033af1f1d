"""Rounds of Trio's loop at the price of what a simulation needs of them.

A run has some forty thousand rounds. In each of them Trio asks the kernel for readable sockets, of which there are none, and
looks some ten times whether an instrument is installed, through a dictionary written in Python. That is a twentieth of a run's
time, so it is left out where the answer is known.
"""

from __future__ import annotations

from typing import Any

import trio

from scenefold.world.sim.time import calls_wait

ROUNDS_BETWEEN_POLLS = 256
"""The kernel is asked every so many rounds all the same: an interrupt from the keyboard comes that way."""


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
    if not runner.instruments:
        runner.instruments = _NoInstruments()
    runner.io_manager = _Polls(runner.io_manager, runner.entry_queue)
