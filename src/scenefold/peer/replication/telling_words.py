"""What a holder is told next, in as few messages as packets hold (specs/20-copies.md, Custody: SetCustody). Pure.

A message says all that its receiver keeps of a scope. So the scope spans whatever that one has not confirmed yet, as far as all between
is known here: what is being recovered may be somebody else's word still.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scenefold.base.limits import CUSTODY_ENTRIES_MAX
from scenefold.base.location import Arc, Location
from scenefold.peer.copies.configurations import Configurations, Word
from scenefold.wire import Member


def words_for(found: Configurations, holder: Member, places: Iterable[Arc], entries_max: int = CUSTODY_ENTRIES_MAX) -> list[Word]:
    """What is to be said to one holder. `places`: what of the arc may be spoken of. Those of which it is a member come first."""
    words: list[Word] = []
    for place in places:
        inside = [segment.arc.intersection(place) for segment in found.segments if holder in segment.untold(found.me)]
        arcs = [arc for arc in inside if arc is not None]
        if arcs:
            scope = Arc(min(arc.first for arc in arcs), max(arc.last for arc in arcs))
            words += _cut(found, holder, scope, _bounds(found, scope), entries_max)
    return sorted(words, key=lambda word: not word.entries)


def _bounds(found: Configurations, scope: Arc) -> list[Location]:
    """Where a scope may be cut: before the first places of segments."""
    firsts = {segment.arc.first for segment in found.segments if scope.first < segment.arc.first <= scope.last}
    return [scope.first, *sorted(firsts)]


def _cut(found: Configurations, holder: Member, scope: Arc, firsts: Sequence[Location], entries_max: int) -> list[Word]:
    word = found.word(holder, scope)
    if len(word.entries) <= entries_max or len(firsts) < 2:
        return [word]
    middle = len(firsts) // 2
    last = Location.from_number(firsts[middle].number - 1)
    left = _cut(found, holder, Arc(scope.first, last), firsts[:middle], entries_max)
    return [*left, *_cut(found, holder, Arc(firsts[middle], scope.last), firsts[middle:], entries_max)]


def untold(found: Configurations) -> list[Member]:
    """Who has not confirmed yet what it is to keep, in order."""
    return _ordered({member for segment in found.segments for member in segment.untold(found.me)})


def members_of(found: Configurations) -> list[Member]:
    """Whoever has something to do with a segment, but for the owner, in order."""
    named = {member for segment in found.segments for member, _ in segment.confirmed}
    named |= {member for segment in found.segments for known in segment.configurations for member in known.members}
    named |= {member for segment in found.segments if segment.change is not None for member in segment.change.holders}
    return _ordered(named - {found.me})


def _ordered(members: Iterable[Member]) -> list[Member]:
    return sorted(members, key=lambda member: (member.node, member.incarnation))
