"""What a holder is told and keeps: custody entries, and how they are cut and joined (specs/20-copies.md, Custody). Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.wire import Member


@dataclass(frozen=True, slots=True)
class Entry:
    """What one holder holds for an owner: as a member of a configuration, or (not whole) as one that is being filled."""

    layout: Layout
    arc: Arc
    number: int
    members: tuple[Member, ...]
    """The owner first. Incarnations, not nodes alone: who comes back with an empty disk is no member of what was before."""
    needed: int
    whole: bool
    fenced: bool = False
    """Another owner has asked what is here: nothing more is taken under this entry, though it may be answered for."""

    @property
    def owner(self) -> Member:
        return self.members[0]

    @property
    def quorum(self) -> int:
        """Once so many others than the owner have spoken, nothing newer was acknowledged than the newest that they have."""
        return len(self.members) - self.needed + 1

    def says(self, other: Entry) -> bool:
        """Whether both say the same of their places."""
        return replace(self, arc=other.arc, fenced=other.fenced) == other


def clipped(entries: Iterable[Entry], scope: Arc) -> list[Entry]:
    """What the entries say of an arc."""
    return [replace(entry, arc=inside) for entry in entries if (inside := entry.arc.intersection(scope)) is not None]


def alike(told: Mapping[Member, Iterable[Entry]], gap: Arc) -> Iterator[tuple[Arc, dict[Member, Entry]]]:
    """The gap in parts, in order, in each of which every member says one thing or nothing. `told`: of one layout, and within the gap.

    One pass, however many there are: who lies may name thousands. Of several of one member at one place, which it should not have, one counts.
    """
    begins: dict[Location, dict[Member, Entry]] = {gap.first: {}}
    ends: dict[Location, list[tuple[Member, Entry]]] = {}
    for member, entries in told.items():
        for entry in entries:
            begins.setdefault(entry.arc.first, {})[member] = entry
            behind = entry.arc.last.next()
            if behind is not None and behind in gap:
                ends.setdefault(behind, []).append((member, entry))
    here: dict[Member, Entry] = {}
    firsts = sorted({*begins, *ends})
    lasts = [*(Location.from_number(first.number - 1) for first in firsts[1:]), gap.last]
    for first, last in zip(firsts, lasts, strict=True):
        for member, entry in ends.get(first, ()):
            if here.get(member) is entry:
                del here[member]
        here.update(begins.get(first, {}))
        yield Arc(first, last), {member: here[member] for member in told if member in here}


def joined(entries: Iterable[Entry]) -> tuple[Entry, ...]:
    """In order of layouts and places, neighbours that say the same as one."""
    found: list[Entry] = []
    for entry in sorted(entries, key=lambda entry: (entry.layout, entry.arc.first)):
        last = found[-1] if found else None
        if last is not None and last.arc.last.next() == entry.arc.first and replace(last, arc=entry.arc) == entry:
            found[-1] = replace(last, arc=Arc(last.arc.first, entry.arc.last))
        else:
            found.append(entry)
    return tuple(found)
