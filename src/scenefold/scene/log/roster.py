"""Who decides a scene's log, and who is asked besides, as its records say it (specs/16-scene-log.md, Participants). Pure.

The records are what members read. Nodes without a key go by the public header, which says the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.limits import DECIDERS_MAX, PARTICIPANTS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.wire import (
    AddObserver,
    AddParticipant,
    Member,
    ParticipantEntry,
    RemoveObserver,
    RemoveParticipant,
)

Entries = tuple[ParticipantEntry, ...]
"""By their nodes' ids."""
_REMEMBERED_MAX = 256
"""Lists that were looked at: those who take part change seldom, and each header names them."""


@dataclass(frozen=True, slots=True)
class Roster:
    """Of one position: those who decide the next one. As long as there are no participants, the scene's origin does."""

    participants: Entries = ()
    observers: Entries = ()

    def entered(self, entry: AddParticipant | RemoveParticipant | AddObserver | RemoveObserver) -> Roster:
        """After one more entry; Refused if it does not fit."""
        match entry:
            case AddParticipant(member, key):
                return replace(self, participants=self._joined(self.participants, member, key, DECIDERS_MAX))
            case RemoveParticipant(member):
                if self.participants and not self.participants[1:]:
                    raise _ill_formed("the last participant stays: nobody could decide anything any more")
                return replace(self, participants=_left(self.participants, member))
            case AddObserver(member, key):
                return replace(self, observers=self._joined(self.observers, member, key, PARTICIPANTS_MAX))
            case RemoveObserver(member):
                return replace(self, observers=_left(self.observers, member))

    def check_follows(self, before: Roster) -> None:
        """Refused unless this may be the next position's."""
        why = misfit(before.participants, before.observers, self.participants, self.observers)
        if why:
            raise _ill_formed(why)

    def _joined(self, entries: Entries, member: Member, key: bytes, most: int) -> Entries:
        if any(other.member.node == member.node for other in (*self.participants, *self.observers)):
            raise _ill_formed(f"node {member.node} takes part already, as participant or observer")
        if len(entries) >= most:
            raise _ill_formed(f"{most} nodes of this kind are the most")
        return by_node((*entries, ParticipantEntry(member, key)))


def by_node(entries: Entries) -> Entries:
    """In their one order."""
    return tuple(sorted(entries, key=lambda entry: entry.member.node))


def misfit(participants: Entries, observers: Entries, next_participants: Entries, next_observers: Entries) -> str:
    """Why the position after one with such participants and observers cannot have those; empty if it can."""
    if not participants:
        return unlawful(next_participants, next_observers)
    if not next_participants:
        return "a log that participants decide keeps one at least"
    changes = set(participants) ^ set(next_participants), set(observers) ^ set(next_observers)
    if sum(map(len, changes)) > 1:
        return "who takes part changes by one node at a position"
    return unlawful(next_participants, next_observers)


@lru_cache(_REMEMBERED_MAX)
def unlawful(participants: Entries, observers: Entries) -> str:
    """What is wrong with these lists, whatever was before; empty if nothing is."""
    nodes = [entry.member.node for entry in (*participants, *observers)]
    if len(set(nodes)) != len(nodes):
        return "a node takes part once, as participant or observer"
    if (participants, observers) != (by_node(participants), by_node(observers)):
        return "who takes part stands in the order of the nodes' ids"
    try:
        for entry in (*participants, *observers):
            PublicKey(entry.key)
    except DamagedData:
        return f"the key of node {entry.member.node} is none"
    return ""


def _left(entries: Entries, member: Member) -> Entries:
    if not any(entry.member == member for entry in entries):
        raise _ill_formed(f"node {member.node} does not take part in this incarnation")
    return tuple(entry for entry in entries if entry.member != member)


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="scene log")
