"""What clients asked of a scene's log, what they were told, and whether the log is one that explains it (specs/17-simulation.md, Logs). Pure.

The unit is the **attempt**: one asking, under a request id that several attempts may share. Its moments are numbers of one counter over
the run, since much happens at one virtual instant.
"""

from __future__ import annotations

import bisect
import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from scenefold.simulation import laws
from scenefold.simulation.history import NEVER_ENDED

Request = bytes


class Told(Enum):
    """What became of an attempt."""

    COMMITTED = "committed"
    """At a position."""
    REFUSED = "refused"
    """This attempt did not bring it into the log, and never will."""
    NEVER = "never"
    """No attempt that was begun before this one did, nor this one, and none of them ever will."""
    UNKNOWN = "unknown"
    """It may be in the log, or come there at any time."""


class Wrong(NamedTuple):
    """A law that does not hold, and how."""

    law: str
    what: str


@dataclass(slots=True, eq=False)
class Attempt:
    """One asking; UNKNOWN until it ends, and perhaps for ever."""

    request: Request
    who: str
    begin: int
    at_s: float
    end: int = NEVER_ENDED
    told: Told = Told.UNKNOWN
    position: int = 0

    def __str__(self) -> str:
        return f"{self.request.hex()[:8]} of {self.who}, asked at {self.at_s:.3f} s,"


@dataclass(slots=True)
class LogHistory:
    """All attempts of a run, in the order of their beginnings."""

    attempts: list[Attempt] = field(default_factory=list)
    _moments: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def asks(self, request: Request, who: str, at_s: float) -> Attempt:
        """An attempt begins."""
        attempt = Attempt(request, who, next(self._moments), at_s)
        self.attempts.append(attempt)
        return attempt

    def ends(self, attempt: Attempt, told: Told, position: int = 0) -> None:
        """It has been answered, or given up; UNKNOWN then, and what was asked for may still be decided."""
        attempt.told, attempt.position, attempt.end = told, position, next(self._moments)

    def outcomes(self) -> Mapping[Request, Told]:
        """What became of each request, by the word of clients: the best that any attempt was told."""
        found: dict[Request, Told] = {}
        for attempt in self.attempts:
            found[attempt.request] = min(attempt.told, found.get(attempt.request, Told.UNKNOWN), key=list(Told).index)
        return found


def wrong_answers(attempts: Iterable[Attempt], at: Mapping[Request, int]) -> list[Wrong]:
    """What was told and is not so. `at`: the position of each request that is decided, anywhere."""
    found = list(attempts)
    of_request = defaultdict[Request, list[Attempt]](list)
    for attempt in found:
        of_request[attempt.request].append(attempt)
    wrong = [one for attempt in found for one in _untrue(attempt, of_request[attempt.request], at)]
    return [*wrong, *_out_of_order(found, of_request, at)]


def _untrue(attempt: Attempt, others: list[Attempt], at: Mapping[Request, int]) -> Iterator[Wrong]:
    position = at.get(attempt.request)
    if attempt.told is Told.COMMITTED and position is None:
        yield Wrong(laws.ENTRIES_STAY, f"{attempt} was acknowledged at position {attempt.position}, and is in no log")
    elif attempt.told is Told.COMMITTED and position != attempt.position:
        yield Wrong(laws.ENTRIES_STAY, f"{attempt} was acknowledged at position {attempt.position}, and is at {position}")
    elif position is not None and _denies(attempt, others):
        yield Wrong(laws.REFUSED_STAYS_OUT, f"{attempt} was told {attempt.told.value!r}, and is at position {position}")


def _denies(attempt: Attempt, others: list[Attempt]) -> bool:
    """Whether this answer says that the request is not in the log, for ever, whatever other attempts there were."""
    beside = [other for other in others if other is not attempt]
    if any(other.begin > attempt.begin for other in beside):
        # Who asks again, asks for it to come in.
        return False
    if attempt.told is Told.NEVER:
        # One that was still being made when this was asked may go on behind it.
        return all(other.end < attempt.begin for other in beside)
    return attempt.told is Told.REFUSED and all(other.told in (Told.REFUSED, Told.NEVER) for other in beside)


def _out_of_order(attempts: list[Attempt], of_request: Mapping[Request, list[Attempt]], at: Mapping[Request, int]) -> Iterator[Wrong]:
    """Real time: what was acknowledged before another one was asked for the first time lies before that."""
    ended = sorted((one for one in attempts if one.told is Told.COMMITTED), key=lambda one: one.end)
    ends = [one.end for one in ended]
    highest = list(itertools.accumulate(ended, _later))
    for request, own in of_request.items():
        first = min(own, key=lambda one: one.begin)
        before = bisect.bisect_left(ends, first.begin)
        if before and request in at and highest[before - 1].position > at[request]:
            known = highest[before - 1]
            what = f"{known} was acknowledged at position {known.position} before {first} and that one is at {at[request]}"
            yield Wrong(laws.REAL_TIME, what)


def _later(one: Attempt, other: Attempt) -> Attempt:
    return one if one.position >= other.position else other
