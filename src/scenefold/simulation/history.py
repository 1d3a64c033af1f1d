"""What clients did to each location, as intervals (specs/17-simulation.md, Histories). Pure.

An attempt is one record in one packet, because that is what can happen once or not at all: a client's put that had to be
sent again is several attempts of one digest. Moments are numbers of one counter over the whole run, not seconds: in virtual
time much happens at the same instant, and yet in one order.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from scenefold.base.location import Location
from scenefold.crypto import OBJECT_BYTES, wanted_place

Digest = bytes
NEVER_ENDED = 1 << 62
"""The end of an attempt that has no known outcome: it may take effect at any time later."""


class Place(NamedTuple):
    """What one history is of."""

    scene: int
    space: int
    location: bytes
    """Of a node-managed record its object id."""

    @property
    def is_object(self) -> bool:
        return len(self.location) == OBJECT_BYTES

    @property
    def home(self) -> Location:
        """The place whose owner decides about it."""
        return wanted_place(self.location) if self.is_object else Location(self.location)


class Version(NamedTuple):
    """A record's place in the order of versions; `order` compares, `digest` names it for `expect` and in reads."""

    order: tuple[int, int, int, int, bytes]
    digest: Digest


class Outcome(Enum):
    """What an attempt to write came to."""

    DONE = "done"
    REFUSED = "refused"
    """For its version or its expectation; it had no effect."""
    MAYBE = "maybe"
    """No answer, or one that leaves it open."""


@dataclass(frozen=True, slots=True)
class Write:
    """An attempt to put a record. `expect`: None, b"" (nothing there), or the digest that is replaced."""

    begin: int
    end: int
    version: Version
    expect: Digest | None
    outcome: Outcome
    who: str = ""
    at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Read:
    """An answer to a get: the digest there, or None for nothing."""

    begin: int
    end: int
    digest: Digest | None
    who: str = ""
    at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Listing:
    """An answer to a range that covers the place: whether it was among what is there."""

    begin: int
    end: int
    present: bool
    who: str = ""
    at_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Loss:
    """From here on the newest version may be gone, since no disk that still counts holds it (custody.py).

    What is there then is nothing, or one of `left`: the versions that some disk still holds. Each of those may also
    come back later, if it is higher than what is there by then. What was written later is above `newest`, which was the
    newest version on any disk: it is not excused (None: not known, anything may be gone).
    """

    begin: int
    left: tuple[Version, ...]
    why: str = ""
    at_s: float = 0.0
    newest: Version | None = None
    or_nothing: bool = True
    """False: what is there then is one of `left`, the lowest of which is with somebody who is asked."""


@dataclass(frozen=True, slots=True)
class Return:
    """A version that a disk holds where its place's owner does not (a backup that was restored, say) may come back from
    here on: it takes effect where it is higher than what is there."""

    begin: int
    version: Version


@dataclass(frozen=True, slots=True)
class Purge:
    """An attempt to have a deleted record dropped for good: where this version is there, nothing is, and nothing older ever again.

    `is_done`: the owner says that it is gone. Else it may take effect at any time from the beginning on, or never.
    """

    begin: int
    end: int
    version: Version
    is_done: bool
    who: str = ""
    at_s: float = 0.0


Event = Write | Read | Listing | Loss | Return | Purge


class Histories:
    """Events by place. `moment()` numbers what happens."""

    def __init__(self) -> None:
        self.by_place: dict[Place, list[Event]] = {}
        self.writes_done = 0
        self.reads_done = 0
        self._moment = 0

    def moment(self) -> int:
        self._moment += 1
        return self._moment

    def add(self, place: Place, event: Event) -> None:
        self.by_place.setdefault(place, []).append(event)
        if isinstance(event, Write):
            self.writes_done += event.outcome is Outcome.DONE
        elif isinstance(event, Read):
            self.reads_done += 1

    def of(self, place: Place) -> list[Event]:
        return self.by_place.get(place, [])

    def places(self) -> Iterable[Place]:
        """All places, in the order of the line."""
        return sorted(self.by_place)
