"""Who holds copies of what for whom: the structs of custody (specs/20-copies.md, Custody, Configurations).

They say the same from three sides: what a holder keeps, what an owner keeps, and what a holder's answer is worth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scenefold.base.limits import CONFIGURATIONS_MAX, COPIES_MAX, CUSTODY_ENTRIES_MAX, SHADOWS_MAX
from scenefold.base.location import FIRST
from scenefold.wire.common import BOOL, LOCATION, U32, U64, Location, NodeId
from scenefold.wire.containers import Many, Struct, many_locations
from scenefold.wire.kinds import Uint
from scenefold.wire.laws import All, Distinct, Order
from scenefold.wire.scene_log_packets import MEMBER, Member


@dataclass(frozen=True, slots=True)
class Configuration:
    """Nodes that hold an arc's records of one layout: the owner of that time first, then all holders."""

    layout: tuple[Location, ...]
    """Offsets of the shadows, in the order of their numbers."""
    first: Location
    last: Location
    number: int
    members: tuple[NodeId, ...]
    needed: int
    """Of these, how many have a record before it is acknowledged."""


@dataclass(frozen=True, slots=True)
class CustodyEntry:
    """A configuration as one of its holders keeps it: for whom, and whether all of it is there."""

    owner: Member
    layout: tuple[Location, ...]
    first: Location
    last: Location
    number: int
    members: tuple[NodeId, ...]
    needed: int
    whole: bool
    """Its copy of the arc is complete; else it is still being filled and answers for nothing."""


@dataclass(frozen=True, slots=True)
class Holders:
    """What a holder's answer counts under: as much of its custody entry as who reads has to know."""

    owner: Member
    number: int
    members: tuple[NodeId, ...]
    needed: int


@dataclass(frozen=True, slots=True)
class Led:
    """The owner is the first of the members."""

    def holds(self, value: Any) -> bool:
        return bool(value.members and value.members[0] == value.owner.node)

    def __str__(self) -> str:
        return "owner first of members"


@dataclass(frozen=True, slots=True)
class Peopled:
    """There is an owner at least."""

    def holds(self, value: Any) -> bool:
        return bool(value.members)

    def __str__(self) -> str:
        return "members not empty"


@dataclass(frozen=True, slots=True)
class LaidOut:
    """No two shadows lie at one place, and none where its parent lies."""

    def holds(self, value: Any) -> bool:
        return len(set(value.layout)) == len(value.layout) and FIRST not in value.layout

    def __str__(self) -> str:
        return "offsets in layout distinct and not 0"


_ARC = (("layout", many_locations(SHADOWS_MAX)), ("first", LOCATION), ("last", LOCATION))
_GROUP = (("number", U64), ("members", Many(U32, COPIES_MAX)), ("needed", Uint(8, least=1, most=COPIES_MAX)))
_ASCENDING, _ONCE = Order("first", "last"), Distinct("members")

CONFIGURATION = Struct(Configuration, *_ARC, *_GROUP, law=All((_ASCENDING, LaidOut(), Peopled(), _ONCE)))
CUSTODY_ENTRY = Struct(CustodyEntry, ("owner", MEMBER), *_ARC, *_GROUP, ("whole", BOOL), law=All((_ASCENDING, LaidOut(), Led(), _ONCE)))
HOLDERS = Struct(Holders, ("owner", MEMBER), *_GROUP, law=All((Led(), _ONCE)))
CONFIGURATIONS = Many(CONFIGURATION, CONFIGURATIONS_MAX)
CUSTODY_ENTRIES = Many(CUSTODY_ENTRY, CUSTODY_ENTRIES_MAX)
STRUCTS = (CONFIGURATION, CUSTODY_ENTRY, HOLDERS)
