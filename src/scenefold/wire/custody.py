"""Who holds copies of what for whom: the structs of custody (specs/20-copies.md, Custody, Configurations).

They say the same from three sides: what a holder keeps, what an owner keeps, and what a holder's answer is worth.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from scenefold.base.limits import (
    CONFIGURATIONS_MAX,
    COPIES_MAX,
    CUSTODY_ENTRIES_MAX,
    SEGMENT_CONFIGURATIONS_MAX,
    SEGMENT_CONFIRMED_MAX,
    SHADOWS_MAX,
)
from scenefold.base.location import FIRST
from scenefold.wire.common import BOOL, LOCATION, U64, Location
from scenefold.wire.containers import Many, Struct, many_locations
from scenefold.wire.kinds import Uint
from scenefold.wire.laws import All, Order
from scenefold.wire.members import MEMBER, Member


@dataclass(frozen=True, slots=True)
class Configuration:
    """Who answers for a piece together: the owner of that time first, then all holders. Incarnations, so nobody whose disk was wiped since."""

    number: int
    members: tuple[Member, ...]
    needed: int
    """Of these, how many have a record before it is acknowledged."""

    @property
    def quorum(self) -> int:
        """Once so many members that are not the owner have spoken, nothing newer was acknowledged than the newest that they have."""
        return len(self.members) - self.needed + 1

    @property
    def rank(self) -> tuple[object, ...]:
        """By which they are in order. Of one number there is one, unless somebody lies: then nobody can tell which, and all count."""
        return self.number, tuple((member.node, member.incarnation) for member in self.members), self.needed


@dataclass(frozen=True, slots=True)
class Confirmed:
    """A node that has no entry below this number any more, certainly."""

    member: Member
    number: int


@dataclass(frozen=True, slots=True)
class PassedSegment:
    """What the new owner of a piece has to know of those who hold copies of it."""

    layout: tuple[Location, ...]
    """Offsets of the shadows, in the order of their numbers."""
    first: Location
    last: Location
    configurations: tuple[Configuration, ...]
    """All by which somebody may still be answered, the newest last."""
    confirmed: tuple[Confirmed, ...]


@dataclass(frozen=True, slots=True)
class CustodyEntry:
    """A configuration as one of its holders keeps it for the first of the members, and whether all of it is there."""

    layout: tuple[Location, ...]
    first: Location
    last: Location
    number: int
    members: tuple[Member, ...]
    needed: int
    whole: bool
    """Its copy of the arc is complete; else it is still being filled and answers for nothing."""


@dataclass(frozen=True, slots=True)
class Enough:
    """There is an owner, nobody twice, and no more are needed than there are."""

    def holds(self, value: Any) -> bool:
        return len(set(value.members)) == len(value.members) and value.needed <= len(value.members)

    def __str__(self) -> str:
        return "members distinct, needed of them at most all"


@dataclass(frozen=True, slots=True)
class LaidOut:
    """No two shadows lie at one place, and none where its parent lies."""

    def holds(self, value: Any) -> bool:
        return len(set(value.layout)) == len(value.layout) and FIRST not in value.layout

    def __str__(self) -> str:
        return "offsets in layout distinct and not 0"


@dataclass(frozen=True, slots=True)
class Rising:
    """Configurations are in order, and none is there twice."""

    def holds(self, value: Any) -> bool:
        return all(one.rank < other.rank for one, other in pairwise(value.configurations))

    def __str__(self) -> str:
        return "configurations by number, members, needed"


@dataclass(frozen=True, slots=True)
class Passed:
    """Of what passes with a piece each place is told once of a layout, in order."""

    def holds(self, value: Any) -> bool:
        return all((one.layout, one.last) < (other.layout, other.first) for one, other in pairwise(value.segments))

    def __str__(self) -> str:
        return "segments by layout and place, of one layout apart"


@dataclass(frozen=True, slots=True)
class Single:
    """A node confirms one number."""

    def holds(self, value: Any) -> bool:
        return len({confirmed.member for confirmed in value.confirmed}) == len(value.confirmed)

    def __str__(self) -> str:
        return "members of confirmed distinct"


_ARC = (("layout", many_locations(SHADOWS_MAX)), ("first", LOCATION), ("last", LOCATION))
_GROUP = (("number", U64), ("members", Many(MEMBER, COPIES_MAX)), ("needed", Uint(8, least=1, most=COPIES_MAX)))
_ASCENDING = Order("first", "last")

CONFIGURATION = Struct(Configuration, *_GROUP, law=Enough())
CONFIRMED = Struct(Confirmed, ("member", MEMBER), ("number", U64))
PASSED_SEGMENT = Struct(
    PassedSegment,
    *_ARC,
    ("configurations", Many(CONFIGURATION, SEGMENT_CONFIGURATIONS_MAX)),
    ("confirmed", Many(CONFIRMED, SEGMENT_CONFIRMED_MAX)),
    law=All((_ASCENDING, LaidOut(), Rising(), Single())),
)
CUSTODY_ENTRY = Struct(CustodyEntry, *_ARC, *_GROUP, ("whole", BOOL), law=All((_ASCENDING, LaidOut(), Enough())))
PASSED_SEGMENTS = Many(PASSED_SEGMENT, CONFIGURATIONS_MAX)
CUSTODY_ENTRIES = Many(CUSTODY_ENTRY, CUSTODY_ENTRIES_MAX)
STRUCTS = (CONFIGURATION, CONFIRMED, PASSED_SEGMENT, CUSTODY_ENTRY)
