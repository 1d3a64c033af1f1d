"""What a node holds for others, as a value (specs/20-copies.md, Custody). Pure.

What must never happen is that a configuration comes back at a holder that the owner counts as over for it: by a message that was
on its way for long, or of who owned the place before. So beside its entries a holder keeps **floors**: at each place the highest
number that it was told, or has promised, whether it holds something there or not. Below it nothing is taken any more.
A floor that is too high costs an owner one more round trip; so when there are too many, neighbours become one.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from scenefold.base.cover import without
from scenefold.base.errors import Refused
from scenefold.base.limits import CUSTODY_FLOORS_MAX, CUSTODY_KEPT_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.entries import Entry, clipped, joined
from scenefold.wire import Member


class Behind(Refused):
    """Something there has this number or a higher one: the owner has to take one above `highest`."""

    def __init__(self, highest: int) -> None:
        super().__init__(RejectReason.POSITION_BEHIND, f"number {highest} was met there")
        self.highest = highest


@dataclass(frozen=True, slots=True)
class Floor:
    """In this arc nothing is taken that is not above this number."""

    arc: Arc
    number: int


@dataclass(frozen=True)
class Custody:
    """Entries and floors, each in order. A new incarnation begins without any: what lies on its disk are strays."""

    entries: tuple[Entry, ...] = ()
    floors: tuple[Floor, ...] = ()

    # ------------------------------------------------------------------------------------------------- questions

    def at(self, layout: Layout, location: Location) -> Entry | None:
        """The entry of a place; there is at most one of each layout."""
        firsts, entries = self._by_layout.get(layout, ((), ()))
        index = bisect_right(firsts, location) - 1
        return entries[index] if index >= 0 and location in entries[index].arc else None

    def takes_from(self, owner: Member, layout: Layout, location: Location) -> bool:
        """Whether copies of this place are stored for that owner."""
        entry = self.at(layout, location)
        return entry is not None and entry.owner == owner and not entry.fenced

    def answers(self, layout: Layout, location: Location) -> Entry | None:
        """The entry to answer a read with, if the copy is complete."""
        entry = self.at(layout, location)
        return entry if entry is not None and entry.whole else None

    @property
    def layouts(self) -> Collection[Layout]:
        """Those of the entries."""
        return self._by_layout.keys()

    def arcs(self, layout: Layout) -> list[Arc]:
        """Where records of spaces of this layout lie by right, for whomever: in order, joined."""
        found: list[Arc] = []
        for entry in self._by_layout.get(layout, ((), ()))[1]:
            if found and found[-1].last.next() == entry.arc.first:
                found[-1] = Arc(found[-1].first, entry.arc.last)
            else:
                found.append(entry.arc)
        return found

    def within(self, scope: Arc) -> list[Entry]:
        """What is held of an arc, cut to it: what is told to who recovers it."""
        return clipped(self.entries, scope)

    def highest(self, scope: Arc) -> int:
        """The highest number that was met in an arc; 0 if there was none."""
        return max((floor.number for floor in self.floors if floor.arc.intersection(scope) is not None), default=0)

    @cached_property
    def _by_layout(self) -> dict[Layout, tuple[list[Location], list[Entry]]]:
        found: dict[Layout, tuple[list[Location], list[Entry]]] = {}
        for entry in self.entries:
            firsts, entries = found.setdefault(entry.layout, ([], []))
            firsts.append(entry.arc.first)
            entries.append(entry)
        return found

    # --------------------------------------------------------------------------------------------------- changes

    def set(self, owner: Member, number: int, scope: Arc, entries: Sequence[Entry]) -> Custody:
        """From now on exactly this is held within the scope, of all layouts. Behind if a number there is not below `number`.

        An entry that stays as it is keeps its own number; any other has one above all that was met at its place.
        What is so already is answered as such, however late it is said again.
        """
        if any(entry.owner != owner or entry.number > number or not _inside(entry.arc, scope) for entry in entries):
            raise Refused(RejectReason.ILL_FORMED, "custody is set by its owner, under its own number, within the scope")
        said = joined(replace(entry, fenced=False) for entry in entries)
        kept: list[Entry] = []
        rest = [scope]
        for floor in self.floors:
            place = floor.arc.intersection(scope)
            if place is None:
                continue
            here, there = self.within(place), clipped(said, place)
            if floor.number >= number:
                if joined(replace(entry, fenced=False) for entry in here) != joined(there):
                    raise Behind(self.highest(scope))
                kept += here
                rest = [left for piece in rest for left in without(piece, place)]
            elif any(entry.number <= floor.number and not self._has(entry) for entry in there):
                raise Behind(self.highest(scope))
        new = [entry for piece in rest for entry in clipped(said, piece)]
        if not new and kept == self.within(scope) and not rest:
            return self
        return Custody(_bounded([*_outside(self.entries, scope), *kept, *new]), self.floors)._floored(scope, number)

    def promise(self, arc: Arc, number: int) -> Custody:
        """Take nothing below this number there, and store nothing more for whom it is held now.

        Who recovers a place asks for that, and so it learns of every configuration that may still be answered for; who gives a piece away
        promises it to itself. What is whole stays so: it answers like before. Behind if an entry there has that number or a higher one:
        then a later owner is heard here already. A floor that is as high says nothing of the kind, since neighbours may have become one
        with it; and it promises more than is asked.
        """
        held = self.within(arc)
        if any(entry.number >= number for entry in held):
            raise Behind(max(self.highest(arc), *(entry.number for entry in held)))
        fenced = [replace(entry, fenced=True) for entry in held]
        return Custody(joined([*_outside(self.entries, arc), *fenced]), self.floors)._floored(arc, number - 1)

    def claim(self, arc: Arc) -> Custody:
        """This node owns the arc now, so it holds nothing there for others. What was met stays known."""
        if not self.within(arc):
            return self
        return Custody(joined(_outside(self.entries, arc)), self.floors)

    # --------------------------------------------------------------------------------------------------- helpers

    def _has(self, said: Entry) -> bool:
        """Whether all of an entry is here as it is said."""
        return any(_inside(said.arc, entry.arc) and entry.says(said) for entry in self.entries)

    def _floored(self, scope: Arc, number: int) -> Custody:
        """With a floor at least that high; entries keep their order."""
        pieces: list[Floor] = []
        rest = [scope]
        for floor in self.floors:
            inside = floor.arc.intersection(scope)
            pieces += [replace(floor, arc=left) for left in without(floor.arc, inside)]
            if inside is not None:
                pieces.append(Floor(inside, max(number, floor.number)))
                rest = [left for piece in rest for left in without(piece, inside)]
        return Custody(self.entries, _coarse([*pieces, *(Floor(piece, number) for piece in rest)]))


def _inside(arc: Arc, scope: Arc) -> bool:
    return scope.first <= arc.first and arc.last <= scope.last


def _outside(entries: Iterable[Entry], scope: Arc) -> list[Entry]:
    return [replace(entry, arc=rest) for entry in entries for rest in without(entry.arc, scope)]


def _bounded(entries: list[Entry]) -> tuple[Entry, ...]:
    found = joined(entries)
    if len(found) > CUSTODY_KEPT_MAX:
        raise Refused(
            RejectReason.LIMIT_EXCEEDED,
            f"this node holds copies of {CUSTODY_KEPT_MAX} pieces of the line, and takes no more",
            remedy="let the line settle, or add nodes",
        )
    return found


def _coarse(floors: Iterable[Floor]) -> tuple[Floor, ...]:
    """In order, neighbours that are equal as one; if they are too many, those nearest in number with all between them."""
    found: list[Floor] = []
    for floor in sorted(floors, key=lambda floor: floor.arc.first):
        if found and found[-1].number == floor.number and found[-1].arc.last.next() == floor.arc.first:
            found[-1] = Floor(Arc(found[-1].arc.first, floor.arc.last), floor.number)
        else:
            found.append(floor)
    while len(found) > CUSTODY_FLOORS_MAX:
        index = min(range(len(found) - 1), key=lambda index: abs(found[index].number - found[index + 1].number))
        left, right = found[index : index + 2]
        found[index : index + 2] = [Floor(Arc(left.arc.first, right.arc.last), max(left.number, right.number))]
    return tuple(found)
