"""What placement gives an owner's arc just now, and since when (specs/20-copies.md, Placement, Changing). Pure.

What nodes say of their arcs changes all the time. So each place of the arc has a time since when placement has given it the same holders, and
only what has lasted is made the next configuration: else a bound that is on its way would draw copies behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from scenefold.base.cover import runs, without
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.base.placement import Layout, Line, segments
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.segment import Segment
from scenefold.peer.records.verification import KnownScene
from scenefold.wire import Member

STEADY_S = 10.0
"""So long placement gives other holders before they are taken."""
Piece = tuple[Arc, tuple[Member, ...]]


@dataclass(frozen=True, slots=True)
class Wish:
    """Placement has given these holders for all of the arc since then."""

    arc: Arc
    holders: tuple[Member, ...]
    needed: int
    since: float


@dataclass(frozen=True, slots=True)
class Shortage:
    """A layout for which placement may take fewer nodes than it has shadows. `possible` and `needed`: nodes, the owner included."""

    layout: Layout
    needed: int
    possible: int
    whose: NodeId | None
    """Whose blacklist forbids others; None: there are no others."""
    most: int = 0
    """What the most demanding space of the layout needs for a write; `needed` is what the least demanding one does."""

    @property
    def forbids_writes(self) -> bool:
        return self.possible < self.needed

    def __str__(self) -> str:
        why = "there are no others" if self.whose is None else f"the blacklist of {address_of(self.whose)} forbids others"
        return f"{self.possible} of the {1 + len(self.layout)} nodes that are to hold copies, and {self.needed} are needed: {why}"


@dataclass(frozen=True, slots=True)
class Urgency:
    """What is not put off: that so many nodes (two at least), the owner among them, have each record. `is_there`: who counts for that."""

    wanted: int
    is_there: Callable[[Member], bool]


def needed_of(scenes: Iterable[KnownScene], nodes: int) -> dict[Layout, int]:
    """All layouts there are, and what their configurations ask of every write. `nodes`: how many stand on the line.

    Spaces of one layout may ask for different numbers; then a configuration asks for the lowest one: a reader is satisfied with more that say
    alike, and each space's own number is asked for beside it.
    """
    found: dict[Layout, int] = {}
    for scene in scenes:
        for space, layout in scene.layouts.items():
            if layout:
                needed = min(scene.needed[space], 1 + len(layout), max(1, nodes))
                found[layout] = min(found.get(layout, needed), needed)
    return found


def most_needed(scenes: Iterable[KnownScene], nodes: int) -> dict[Layout, int]:
    """What the most demanding space of each layout asks of every write: so many nodes are placed if they are there, with an arc or without."""
    found: dict[Layout, int] = {}
    for scene in scenes:
        for space, layout in scene.layouts.items():
            if layout:
                found[layout] = max(found.get(layout, 1), min(scene.needed[space], 1 + len(layout), max(1, nodes)))
    return found


def pieces_of(
    line: Line, me: NodeId, layout: Layout, places: Iterable[Arc], allowed: Mapping[NodeId, Member], nodes: Iterable[NodeId], most: int = 1
) -> list[Piece]:
    """What placement gives for these places of the arc. `allowed`: who may be taken, of all the nodes that the line has.

    `most`: so many, the owner among them, a write may ask for.
    """
    forbidden = frozenset(node for node in nodes if node not in allowed)
    found = [piece for place in places for piece in segments(line, me, forbidden, layout, place, most - 1)]
    return runs([(arc, tuple(allowed[node] for node in holders)) for arc, holders in found])


def shortage_of(
    layout: Layout, needed: int, allowed: Collection[NodeId], takable: Collection[NodeId], me: NodeId, waiting: int = 0, most: int = 1
) -> Shortage | None:
    """Why fewer are placed than there are shadows; None if they are not. `takable`: who could be if nobody was forbidden.

    `waiting`: how many of those who are allowed have no arc. They are placed only as far as a write may ask for `most`.
    """
    possible = 1 + min(len(layout), max(len(allowed) - waiting, min(most - 1, len(allowed))))
    if possible > len(layout):
        return None
    return Shortage(layout, needed, possible, me if len(takable) > len(allowed) else None, max(needed, most))


def lasting(before: Sequence[Wish], pieces: Iterable[Piece], needed: int, now: float) -> list[Wish]:
    """What placement gives now; where it has given the same before, since then. `pieces` in order, as those of before were."""
    found: list[Wish] = []
    known = list(before)
    for arc, holders in pieces:
        while known and known[0].arc.last < arc.first:
            known.pop(0)
        rest = [arc]
        for wish in known:
            common = wish.arc.intersection(arc)
            if common is None:
                break
            if (wish.holders, wish.needed) == (holders, needed):
                found.append(replace(wish, arc=common))
                rest = [*rest[:-1], *without(rest[-1], common)]
                if not rest:
                    break
        found += [Wish(left, holders, needed, now) for left in rest]
    return _joined(found)


def ripe(
    found: Configurations,
    layout: Layout,
    wishes: Iterable[Wish],
    now: float,
    is_gone: Callable[[Member], bool],
    only: Urgency | None = None,
    is_forbidden: Callable[[Member], bool] = lambda _member: False,
) -> list[Piece]:
    """What is to be placed at this moment: what has lasted, is the first placement there, or is to do without somebody who was removed, or is forbidden.

    `only`: the first placement there, and where somebody was removed and too few are left; there no more than are wanted at once.
    """
    due: list[Piece] = []
    own = [segment for segment in found.segments if segment.layout == layout]
    for wish in wishes:
        rest = [wish.arc]
        for segment in own:
            common = segment.arc.intersection(wish.arc)
            if common is None:
                continue
            rest = [left for part in rest for left in without(part, common)]
            if _is_due(segment, found.me, wish, now, is_gone, only, is_forbidden):
                due.append((common, wish.holders if only is None else _fewest(segment, found.me, wish, only)))
        due += [(left, wish.holders) for left in rest]
    return runs(sorted(due, key=lambda piece: piece[0].first))


def _is_due(
    segment: Segment,
    me: Member,
    wish: Wish,
    now: float,
    is_gone: Callable[[Member], bool],
    only: Urgency | None,
    is_forbidden: Callable[[Member], bool],
) -> bool:
    target = target_of(segment, me)
    if target is None:
        return True
    holders, needed = target
    if set(holders) == set(wish.holders) and min(needed, 1 + len(holders)) == min(wish.needed, 1 + len(holders)):
        return False
    has_lost = any(map(is_gone, holders))
    if only is not None:
        left = 1 + sum(only.is_there(holder) and not is_gone(holder) for holder in holders)
        return has_lost and left < max(only.wanted, needed)
    if any(map(is_forbidden, holders)) and not any(map(is_forbidden, wish.holders)):
        # Until then writes count on them.
        return True
    return has_lost or now - wish.since >= STEADY_S


def _fewest(segment: Segment, me: Member, wish: Wish, only: Urgency) -> tuple[Member, ...]:
    """Of those that placement gives as many as are wanted, at first those that are there, and of these the holders; all where nobody is placed."""
    target = target_of(segment, me)
    if target is None:
        return wish.holders
    count = max(only.wanted, target[1]) - 1
    kept = sorted(wish.holders, key=lambda holder: (not only.is_there(holder), holder not in target[0]))[:count]
    return tuple(holder for holder in wish.holders if holder in kept)


def target_of(segment: Segment, me: Member) -> tuple[tuple[Member, ...], int] | None:
    """Who holds copies of a segment, or is about to; None as long as its owner has not placed it."""
    if segment.change is not None:
        return segment.change.holders, segment.change.needed
    active = segment.active(me)
    return None if active is None else (active.members[1:], active.needed)


def _joined(wishes: Iterable[Wish]) -> list[Wish]:
    found: list[Wish] = []
    for wish in sorted(wishes, key=lambda wish: wish.arc.first):
        last = found[-1] if found else None
        if last is not None and last.arc.last.next() == wish.arc.first and replace(last, arc=wish.arc) == wish:
            found[-1] = replace(last, arc=Arc(last.arc.first, wish.arc.last))
        else:
            found.append(wish)
    return found
