"""Rates of works on this machine, for what `scenectl bench` prints. The clock is handed in.

A machine's speed drifts, so everything that is compared is one list of works, done once to warm up and then in turns; each has
the median of its rounds, with the least and the most beside it.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

_SECONDS_MIN = 1e-9


@dataclass(frozen=True, slots=True)
class Work:
    """Something to time: `run` does `items` of it."""

    name: str
    items: int
    run: Callable[[], object]


@dataclass(frozen=True, slots=True)
class Rate:
    """Items a second: the median of all rounds, and the two ends."""

    median: float
    least: float
    most: float

    @classmethod
    def of(cls, items: int, seconds: Sequence[float]) -> Rate:
        """That of works of `items` which took so long."""
        rates = [items / each for each in seconds]
        return cls(statistics.median(rates), min(rates), max(rates))


def seconds_in_turns(works: Sequence[Work], clock: Callable[[], float], rounds: int) -> dict[str, list[float]]:
    """How long every work took by `clock` (seconds of processor time, as time.thread_time) in each round; `rounds` >= 1."""
    seconds: dict[str, list[float]] = {work.name: [] for work in works}
    for work in works:
        work.run()
    for _ in range(rounds):
        for work in works:
            begin = clock()
            work.run()
            seconds[work.name].append(max(clock() - begin, _SECONDS_MIN))
    return seconds


def measure_in_turns(works: Sequence[Work], clock: Callable[[], float], rounds: int) -> dict[str, Rate]:
    """The rate of every work; see `seconds_in_turns`."""
    seconds = seconds_in_turns(works, clock, rounds)
    return {work.name: Rate.of(work.items, seconds[work.name]) for work in works}
