"""How fast a node reads its records again, and how far it has come (specs/21-verify.md, Scrub). Pure.

Time is that of running: a node that is off reads nothing, and what it has read meanwhile rots no faster for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

DAY_S = 86_400.0
REST_S = 3_600.0
"""Between two rounds at least; and a store that is read more slowly than a MiB in this time is read so fast."""
LEAST_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Pace:
    """A round lasts so many days, or longer if that needs more bytes a second."""

    days: float
    bytes_per_s_max: int

    def rate(self, total_bytes: int) -> float:
        """Bytes a second, of a store that has so many."""
        return min(self.bytes_per_s_max, max(total_bytes / (self.days * DAY_S), LEAST_BYTES / REST_S))

    def pause_s(self, read_bytes: int, total_bytes: int, *, is_round_over: bool) -> float:
        """How long to wait once so much was read."""
        pause_s = read_bytes / self.rate(total_bytes)
        return max(pause_s, REST_S) if is_round_over else pause_s


class Progress(NamedTuple):
    """How a scrub does: the round, how much of it is done, at what pace, how long the rest takes; how many were rotten in it, and in the one before."""

    round: int
    fraction: float
    bytes_per_s: float
    seconds_left: float
    rotten: int
    rotten_before: int
    paused: bool

    def document(self) -> dict[str, Any]:
        return self._asdict()


@dataclass(frozen=True, slots=True)
class Round:
    """How far a round has come. `after`: the key of the last record that was read, None at the beginning.

    `told`: keys of records that somebody else has found to be rotten, to be looked at before all else.
    """

    number: int = 1
    after: bytes | None = None
    read_bytes: int = 0
    records: int = 0
    rotten: int = 0
    rotten_before: int = 0
    told: tuple[bytes, ...] = ()

    def read(self, after: bytes | None, records: int, read_bytes: int, rotten: int) -> Round:
        """Some more was read, up to a key; None for the end of the store, with which the next round begins."""
        if after is None:
            return Round(self.number + 1, rotten_before=self.rotten + rotten, told=self.told)
        return replace(
            self, after=after, records=self.records + records, read_bytes=self.read_bytes + read_bytes, rotten=self.rotten + rotten
        )

    def progress(self, pace: Pace, total_bytes: int, *, paused: bool) -> Progress:
        """Of a store that has so many bytes. What is deleted and written meanwhile makes all of this an estimate."""
        rate, left = pace.rate(total_bytes), max(0, total_bytes - self.read_bytes)
        fraction = 1.0 - left / total_bytes if total_bytes else 0.0
        return Progress(self.number, fraction, rate, left / rate, self.rotten, self.rotten_before, paused)
