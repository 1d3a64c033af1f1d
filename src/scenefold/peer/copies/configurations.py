"""All that an owner knows of who holds copies of its arc, as a value (specs/20-copies.md, Configurations). Pure.

One number counts for the whole arc: it rises with each change here, and above all that is met. What a holder is to keep is said as a whole
for an arc, under the number of the moment; so whatever order such words come in, a later one is never undone by an earlier one.
A value is made durable before anybody is told of it.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

from scenefold.base.cover import without
from scenefold.base.errors import Refused
from scenefold.base.limits import CONFIGURATIONS_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.entries import Entry, alike, clipped, joined
from scenefold.peer.copies.segment import GONE, Segment
from scenefold.wire import Configuration, Member


@dataclass(frozen=True, slots=True)
class Word:
    """What one holder is told: from `number` on it keeps these entries within the scope, and nothing else."""

    holder: Member
    number: int
    scope: Arc
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Configurations:
    """The segments in order of layouts and places. Transitions answer the value after them, the same one if nothing changes."""

    me: Member
    number: int = 0
    """Not below any that was said or met."""
    segments: tuple[Segment, ...] = ()

    # ------------------------------------------------------------------------------------------------- questions

    def at(self, layout: Layout, location: Location) -> Segment | None:
        firsts, segments = self._by_layout.get(layout, ((), ()))
        index = bisect_right(firsts, location) - 1
        return segments[index] if index >= 0 and location in segments[index].arc else None

    def touching(self, arc: Arc) -> list[Segment]:
        """Of all layouts, what of the segments lies in an arc."""
        return [found for layout in self._by_layout for found in self._within(layout, arc)]

    def word(self, holder: Member, scope: Arc) -> Word:
        """All that a node is to keep of an arc, of all layouts."""
        wanted = [found.wanted(holder, self.me) for found in self.touching(scope)]
        return Word(holder, self.number, scope, joined(entry for entry in wanted if entry is not None))

    def untold(self) -> list[Word]:
        """What is to be said until it is confirmed. Members before those who are none any more."""
        found: dict[tuple[Member, Arc], Word] = {}
        for segment in self.segments:
            for holder in segment.untold(self.me):
                found.setdefault((holder, segment.arc), self.word(holder, segment.arc))
        return sorted(found.values(), key=lambda word: not word.entries)

    @cached_property
    def _by_layout(self) -> dict[Layout, tuple[list[Location], list[Segment]]]:
        found: dict[Layout, tuple[list[Location], list[Segment]]] = {}
        for segment in self.segments:
            firsts, segments = found.setdefault(segment.layout, ([], []))
            firsts.append(segment.arc.first)
            segments.append(segment)
        return found

    # ------------------------------------------------------------------------------------------------------ changes

    def place(self, layout: Layout, pieces: Sequence[tuple[Arc, tuple[Member, ...]]], needed: int) -> Configurations:
        """Placement gives these holders for these pieces of the arc."""
        number = self.number + 1
        arcs = sorted((arc for arc, _ in pieces), key=lambda arc: arc.first)
        rest = [replace(segment, arc=left) for segment in self._of(layout) for left in _without_all(segment.arc, arcs)]
        found: list[Segment] = []
        for arc, holders in pieces:
            inside = self._within(layout, arc)
            gaps = _without_all(arc, [segment.arc for segment in inside])
            found += [segment.place(self.me, holders, needed, number) for segment in [*inside, *(Segment(layout, gap) for gap in gaps)]]
        others = [segment for segment in self.segments if segment.layout != layout]
        after = self._with([*others, *rest, *found], number)
        return self if after.segments == self.segments else after

    def confirm(self, word: Word) -> Configurations:
        """A holder has durably what it was told. Of a segment it may have been told a part."""
        inside, outside = _cut(self.segments, word.scope)
        after = [found.confirm(self.me, word.holder, _confirmed(found, word)) for found in inside]
        if all(new is old for new, old in zip(after, inside, strict=True)):
            return self
        return self._with([*outside, *after], self.number)

    def met(self, word: Word, highest: int) -> Configurations:
        """A holder has met a number that is not below the one it was told: what it has not confirmed is said again, above that."""
        number = max(self.number, highest) + 1

        def again(segment: Segment) -> Segment:
            if segment.arc.intersection(word.scope) is None or segment.wanted(word.holder, self.me) is None:
                return segment
            return segment.renumber(self.me, number) if word.holder in segment.untold(self.me) else segment

        after = self._each(again, number)
        return after if after is not self else replace(self, number=number) if highest >= self.number else self

    def compare(self, holder: Member, entry: Entry) -> Configurations:
        """A holder has compared all of an entry's arc with this owner, and lacks nothing of it but what is owed to it."""
        return self._each(
            lambda found: (
                found.compare(self.me, holder, entry.number) if found.layout == entry.layout and _covers(entry.arc, found) else found
            )
        )

    def remove(self, member: Member) -> Configurations:
        """The log has removed a node, and T_wait has passed since this owner learnt that."""
        number = self.number + 1
        after = [found.remove(self.me, member, number) for found in self.segments]
        if all(new is old for new, old in zip(after, self.segments, strict=True)):
            return self
        return self._with(after, number if any(found.leaving == number for found in after) else self.number)

    def activate(self, debts: Callable[[Segment], Iterable[Collection[Member]] | None]) -> Configurations:
        """Every change that is ready ends. `debts`: of each record there that is owed to somebody, to whom; None: that is not known."""
        number = self.number + 1

        def activated(found: Segment) -> Segment:
            owed = debts(found) if found.can_activate(()) else None
            return found if owed is None else found.activate(self.me, number, owed)

        return self._each(activated, number)

    def gather(self) -> Configurations:
        """Neighbours that have come to the same holders at different times are made active anew together: then they are one.

        Else a bound that wanders to and fro would cut the arc into ever more pieces.
        """
        number = self.number + 1
        alike = [_are_alike(left, right, self.me) for left, right in pairwise(self.segments)]
        is_one = [any(pair) for pair in zip([False, *alike], [*alike, False], strict=True)]
        if not any(is_one):
            return self
        found = zip(self.segments, is_one, strict=True)
        return self._with([segment.renumber(self.me, number) if renewed else segment for segment, renewed in found], number)

    # ------------------------------------------------------------------------------------------------------- pieces

    def give(self, piece: Arc) -> tuple[Configurations, int, tuple[Segment, ...]]:
        """Without a piece; the number below which this node takes nothing there any more; and what its receiver has to know."""
        inside, outside = _cut(self.segments, piece)
        number = self.number + 1
        return self._with(outside, number), number, tuple(segment.given(self.me, number) for segment in inside)

    def take(self, number: int, segments: Iterable[Segment]) -> Configurations:
        """With a piece, and the number that its giver said."""
        number = max(self.number, number) + 1
        return self._with([*self.segments, *(segment.taken(self.me, number) for segment in segments)], number)

    def adopt(self, gap: Arc, heard: Mapping[Member, Sequence[Entry]], number: int) -> Configurations:
        """With a gap of which every registered node has said what it holds, after it had promised to take nothing below `number` there.

        Who was not heard is removed, and T_wait has passed since this node learnt that.
        """
        met = {member: clipped(entries, gap) for member, entries in heard.items() if member != self.me}
        found: list[Segment] = []
        for layout in sorted({entry.layout for entries in met.values() for entry in entries}):
            here = {member: [entry for entry in entries if entry.layout == layout] for member, entries in met.items()}
            found += [_recovered(layout, arc, stretch, heard, number, self.me) for arc, stretch in alike(here, gap) if stretch]
        return self._with([*self.segments, *found], max(self.number, number))

    # --------------------------------------------------------------------------------------------------- helpers

    def _of(self, layout: Layout) -> list[Segment]:
        return self._by_layout.get(layout, ([], []))[1]

    def _within(self, layout: Layout, arc: Arc) -> list[Segment]:
        """The segments of a layout, cut to an arc."""
        firsts, segments = self._by_layout.get(layout, ([], []))
        near = segments[max(0, bisect_right(firsts, arc.first) - 1) : bisect_right(firsts, arc.last)]
        return _cut(near, arc)[0]

    def _each(self, change: Callable[[Segment], Segment], number: int | None = None) -> Configurations:
        after = [change(segment) for segment in self.segments]
        if all(new is old for new, old in zip(after, self.segments, strict=True)):
            return self
        return self._with(after, self.number if number is None else number)

    def _with(self, segments: Iterable[Segment], number: int) -> Configurations:
        found: list[Segment] = []
        for segment in sorted(segments, key=lambda segment: (segment.layout, segment.arc.first)):
            last = found[-1] if found else None
            if last is not None and last.arc.last.next() == segment.arc.first and replace(last, arc=segment.arc) == segment:
                found[-1] = replace(last, arc=Arc(last.arc.first, segment.arc.last))
            else:
                found.append(segment)
        if sum(max(1, len(segment.configurations)) for segment in found) > CONFIGURATIONS_MAX:
            raise Refused(
                RejectReason.LIMIT_EXCEEDED,
                f"the arc falls into more than {CONFIGURATIONS_MAX} pieces with holders of their own",
                remedy="let the line settle, or give a part of it away",
            )
        return replace(self, number=number, segments=tuple(found))


def _cut(segments: Iterable[Segment], arc: Arc) -> tuple[list[Segment], list[Segment]]:
    """What of them lies in an arc, and what outside."""
    inside: list[Segment] = []
    outside: list[Segment] = []
    for segment in segments:
        common = segment.arc.intersection(arc)
        outside += [replace(segment, arc=rest) for rest in without(segment.arc, common)]
        inside += [] if common is None else [replace(segment, arc=common)]
    return inside, outside


def _without_all(arc: Arc, taken: Sequence[Arc]) -> list[Arc]:
    """What is left of an arc without others, which are in order."""
    left = [arc]
    for other in taken[max(0, bisect_right(taken, arc.first, key=lambda found: found.first) - 1) :]:
        if not left or other.first > arc.last:
            break
        left = [*left[:-1], *without(left[-1], other)]
    return left


def _are_alike(left: Segment, right: Segment, me: Member) -> bool:
    """Whether nothing parts them but when they became what they are."""
    one, other = left.active(me), right.active(me)
    if one is None or other is None or left.layout != right.layout or left.arc.last.next() != right.arc.first:
        return False
    are_done = all(segment.is_idle(me) and segment.sound.issuperset(one.members[1:]) for segment in (left, right))
    return are_done and (one.members, one.needed) == (other.members, other.needed)


def _covers(scope: Arc, segment: Segment) -> bool:
    return scope.first <= segment.arc.first and segment.arc.last <= scope.last


def _confirmed(segment: Segment, word: Word) -> int:
    """The number below which a holder that confirms a word certainly has no entry of a segment any more."""
    said = [entry.number for entry in word.entries if entry.layout == segment.layout and entry.arc.intersection(segment.arc) is not None]
    return min([*said, word.number])


def _recovered(layout: Layout, arc: Arc, stretch: Mapping[Member, Entry], heard: Collection[Member], number: int, me: Member) -> Segment:
    """All by which somebody may still be answered: none of those heard takes anything else from before."""
    whole = {(entry.number, entry.members, entry.needed) for entry in stretch.values() if entry.whole}
    configurations = tuple(sorted((Configuration(*found) for found in whole), key=lambda found: found.rank))
    named = {member for found in configurations for member in found.members} | set(stretch)
    bounds = {}
    for member in named - {me}:
        entry = stretch.get(member)
        if entry is None:
            bounds[member] = number if member in heard else GONE
        else:
            bounds[member] = entry.number if entry.whole else number - 1
    return Segment(layout, arc, configurations, confirmed=frozenset(bounds.items()), leaving=number)
