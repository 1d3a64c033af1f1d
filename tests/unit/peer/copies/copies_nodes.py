"""What the model of copies consists of: nodes with what they keep, messages, readers, and the rules that may be left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from scenefold.base.location import FIRST, Arc, Location
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.wire import Member

PLACE = Arc(FIRST, Location.from_number(9))
LAYOUT = (Location.from_number(1000), Location.from_number(2000))
Version = tuple[int, int]
"""A sequence number, and what decides between two that an owner did not know of each other."""
NOTHING: Version = (0, 0)


class Broken(AssertionError):
    """A promise of the specification does not hold."""


@dataclass
class Recovery:
    """What an owner has heard of a gap so far."""

    number: int
    asked: list[Member]
    entries: dict[Member, list[Entry]] = field(default_factory=dict)


@dataclass(eq=False)
class Node:
    member: Member
    configurations: Configurations
    custody: Custody = field(default_factory=Custody)
    version: Version = NOTHING
    debtors: frozenset[Member] = frozenset()
    owns: bool = False
    recovery: Recovery | None = None
    leased: bool = True
    known: int = 0
    """How far it knows the log."""
    # Only in memory:
    have: set[Member] = field(default_factory=set)
    settled: bool = False
    formerly: Entry | None = None
    """What it held of a gap that it has adopted, until that is recovered."""

    @property
    def segment(self) -> Segment:
        return self.configurations.at(LAYOUT, FIRST) or Segment(LAYOUT, PLACE)

    @property
    def entry(self) -> Entry | None:
        return self.custody.at(LAYOUT, FIRST)

    def holders_of_it(self) -> set[Member]:
        """Who has this node's version durably, as far as it knows."""
        return self.have | {self.member} | (self.segment.sound - self.debtors)

    def take(self, version: Version, debtors: frozenset[Member]) -> None:
        self.version, self.debtors, self.have, self.settled = version, debtors, set(), False


@dataclass
class Message:
    target: Member
    deliver: Callable[[Node], None]


@dataclass
class Reader:
    """Somebody who asks holders, one after the other."""

    acknowledged: Version
    told: dict[int, Version] = field(default_factory=dict)
    """The newest that somebody has read before it asked, by the number of the configuration."""
    answers: dict[Member, tuple[Entry, Version]] = field(default_factory=dict)


@dataclass(frozen=True)
class Rules:
    """What may be left out, to see that it is missed."""

    debts: bool = True
    compared: bool = True
    floors: bool = True
    incarnations: bool = True
    promises: bool = True
    leases_of_unheard: bool = True
    settled_when_given: bool = True
