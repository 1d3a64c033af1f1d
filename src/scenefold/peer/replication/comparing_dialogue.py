"""How an owner finds out what a holder has otherwise, in few questions (specs/20-copies.md, Repair). Pure.

Sums of arcs are compared, then of sixteenths of those that differ, then lists of what is left. Of each arc the owner looks at its own disk
before the holder is asked: whatever is written later is owed to the holder from the moment on at which it is there. So what is found
equal, or is brought over, is all that lay here when the owner looked.

The other side may say anything. What it says is followed only as long as an honest one could have said it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from scenefold.base.errors import PeerFault
from scenefold.base.limits import COMPARED_ARCS_MAX, COMPARED_RECORDS_MAX
from scenefold.base.location import LOCATION_BITS, Arc, Location
from scenefold.peer.copies.versions import Rank
from scenefold.store import Spot

CUT = 16
LISTS_MAX = 8
"""Lists of one question: 2,048 records, some 300 KiB."""
UNKNOWN_RECORDS_MAX = 1 << 14
"""Records that another may have here and the owner not, in one dialogue: what is found until then is brought home first."""
_LEVELS = LOCATION_BITS // 4 + 1

Key = tuple[Location, bytes]
"""A record's home, and its object id."""


class Known(NamedTuple):
    """A record on one side: which version, and where it lies there."""

    rank: Rank
    spot: Spot
    size: int = 0


class Part(NamedTuple):
    """What lies in an arc on one side: how many records, and their sum. `records`: None if they are too many, or were not asked for."""

    number: int
    sum: bytes
    records: Mapping[Key, Known] | None = None


@dataclass(frozen=True, slots=True)
class Question:
    """Sums of these arcs, or lists of what lies in them."""

    arcs: tuple[Arc, ...]
    lists: bool


@dataclass(frozen=True, slots=True)
class Differences:
    """What the other side lacks, or has older; and what it has newer, or alone."""

    lacking: list[Known] = field(default_factory=list)
    newer: list[Known] = field(default_factory=list)


class Dialogue:
    """Ask `question`, and give both answers; until there is none. `missing`: about how many records the other side lacks, by its counts."""

    def __init__(self, arcs: Iterable[Arc]) -> None:
        self._sums: list[Arc] = list(arcs)[::-1]
        self._lists: list[Arc] = []
        self._asked: Question | None = None
        self._room: int | None = None
        self.missing = 0

    def question(self) -> Question | None:
        """What to ask next; the same until it is answered."""
        if self._asked is None:
            if len(self._lists) >= LISTS_MAX or (self._lists and not self._sums):
                self._asked = Question(_popped(self._lists, LISTS_MAX), lists=True)
            elif self._sums:
                self._asked = Question(_popped(self._sums, COMPARED_ARCS_MAX), lists=False)
        return self._asked

    def answer(self, own: Sequence[Part], theirs: Sequence[Part]) -> Differences:
        """`own` as it was read before `theirs` was asked for. PeerFault if the other side says what cannot be."""
        asked, self._asked = self._asked, None
        assert asked is not None
        assert len(own) == len(asked.arcs)
        if len(theirs) != len(asked.arcs):
            raise PeerFault(f"sums of {len(theirs)} arcs, where {len(asked.arcs)} were asked for")
        found = Differences()
        for arc, mine, other in zip(asked.arcs, own, theirs, strict=True):
            if (mine.number, mine.sum) == (other.number, other.sum):
                continue
            if not asked.lists:
                self._narrow(arc, mine, other, is_first=self._room is None)
            elif mine.records is None or other.records is None:
                # They were fewer a moment ago.
                self._cut(arc)
            else:
                _compare(arc, mine.records, other.records, found)
        if self._room is None:
            self._room = _LEVELS * (2 + (sum(part.number for part in own) + UNKNOWN_RECORDS_MAX) // (COMPARED_RECORDS_MAX // 4))
        return found

    def _narrow(self, arc: Arc, mine: Part, other: Part, *, is_first: bool) -> None:
        if is_first:
            self.missing += max(0, mine.number - other.number)
        if max(mine.number, other.number) <= COMPARED_RECORDS_MAX:
            self._lists.append(arc)
        else:
            self._cut(arc)

    def _cut(self, arc: Arc) -> None:
        if arc.length == 1:
            raise PeerFault(f"more than {COMPARED_RECORDS_MAX} records with one home")
        if self._room is not None:
            self._room -= 1
            if self._room < 0:
                raise PeerFault("sums that differ in more places than records can lie")
        self._sums += sixteenths(arc)[::-1]


def sixteenths(arc: Arc) -> list[Arc]:
    """The arc in 16 parts as even as whole numbers allow; in fewer if it is shorter."""
    first, length = arc.first.number, arc.length
    parts = min(CUT, length)
    bounds = [first + length * index // parts for index in range(parts + 1)]
    return [Arc(Location.from_number(left), Location.from_number(right - 1)) for left, right in pairwise(bounds)]


def _popped(arcs: list[Arc], count: int) -> tuple[Arc, ...]:
    """The last ones in front, as they are taken."""
    taken = arcs[-count:][::-1]
    del arcs[-count:]
    return tuple(taken)


def _compare(arc: Arc, own: Mapping[Key, Known], theirs: Mapping[Key, Known], found: Differences) -> None:
    _check(arc, theirs.keys())
    for key, mine in own.items():
        other = theirs.get(key)
        if other is None or other.rank < mine.rank:
            found.lacking.append(mine)
    for key, other in theirs.items():
        known = own.get(key)
        if known is None or known.rank < other.rank:
            found.newer.append(other)


def _check(arc: Arc, keys: Collection[Key]) -> None:
    if any(home not in arc for home, _ in keys):
        raise PeerFault("records with their homes elsewhere than was asked for")
