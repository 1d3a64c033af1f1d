"""What is stored here and must not be told yet, since too few have it (specs/20-copies.md, Writes).

A version is *pending* from before it is written until it is settled: on enough disks that no later owner can have lost it, and no
holder answers without it. Whoever would tell of it (reads, lists, refusals) waits; so does who gives its place away. What lies
in a *doubted* part of the arc is all unsettled, whoever wrote it and when.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import trio

from scenefold.base.cover import without
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout
from scenefold.store import Spot
from scenefold.wire import HandItem, Member


class Name(NamedTuple):
    """Which record it is, wherever it lies: `what` is its place, or its object id where nodes choose the places."""

    scene: SceneId
    space: SpaceId
    what: bytes


def name_of(spot: Spot) -> Name:
    return Name(spot.place.scene, spot.place.space, spot.object or spot.place.location)


@dataclass(slots=True, eq=False)
class Pending:
    """One version, and who has it durably."""

    spot: Spot
    version: bytes
    layout: Layout
    needed: int
    """What its space asks for."""
    debtors: frozenset[NodeId]
    """Whoever was to get it when it was written, paid or not. Others that are sound have it."""
    have: set[Member]
    """Who has said so, this owner among them."""
    size: int
    """At most: its ciphertext's."""
    item: HandItem | None = None
    """None: it is to be read from the disk when it is sent."""
    is_write: bool = True
    """A client's that waits, which counts by what its space asks for. Anything else may be told once all have it that may hold it, if they are fewer."""
    is_stored: bool = False
    """Until then it is on no disk, this node's own among them: it is neither sent nor judged."""
    judged: object = None
    """By which rule it was judged last."""
    is_settled: bool = False
    left: set[Member] = field(default_factory=set)
    """Who has what is left of it, since nobody has its bytes any more: none of them says that something older is there."""
    settled: trio.Event | None = None
    """Made by who waits first."""

    @classmethod
    def of_stored(
        cls, spot: Spot, version: bytes, layout: Layout, needed: int, debtors: Iterable[NodeId], me: Member, size: int
    ) -> Pending:
        """Of what is on the disk, and no client waits for."""
        return cls(spot, version, layout, needed, frozenset(debtors), {me}, size, is_write=False, is_stored=True)

    @property
    def home(self) -> Location:
        return self.spot.home

    async def wait(self) -> None:
        """Return once it is settled, or was never stored."""
        if not self.is_settled:
            if self.settled is None:
                self.settled = trio.Event()
            await self.settled.wait()


PAGE = 512
"""What is pending may be much: who walks through all of it lets others run after so many."""


class Doubt(NamedTuple):
    """A part of the arc of which all that has this layout is unsettled. `rules`: 2, or only the second one."""

    layout: Layout
    arc: Arc
    rules: int


@dataclass
class Unsettled:
    """Used from the Trio thread only; what lies between two awaits is atomic."""

    is_read: bool = True
    """Whether all that this node owed at its start has been looked through. Until then anything may be unsettled."""
    doubts: tuple[Doubt, ...] = ()
    _count: int = 0
    _by_name: dict[Name, list[Pending]] = field(default_factory=dict)
    _homes: Counter[Location] = field(default_factory=Counter)
    """Of how many records with these homes something is pending."""
    _changed: trio.Event = field(default_factory=trio.Event)

    def __len__(self) -> int:
        return self._count

    @property
    def is_quiet(self) -> bool:
        """Whether all that is here may be told."""
        return not self._by_name and self.is_read and not self.doubts

    # -------------------------------------------------------------------------------------------------- questions

    def of(self, name: Name) -> list[Pending]:
        """The versions of a record that are pending, in the order in which they were given to the store."""
        return list(self._by_name.get(name, ()))

    def pages(self) -> Iterator[Sequence[Pending]]:
        """All that is pending when this is called, a part at a time."""
        found = [pending for versions in self._by_name.values() for pending in versions]
        return (found[start : start + PAGE] for start in range(0, len(found), PAGE))

    def listed(self, scene: SceneId, space: SpaceId, arc: Arc) -> Iterator[Sequence[Pending]]:
        """What is pending in an arc of a space when this is called, a part at a time."""
        return ([one for one in page if _is_listed(one.spot, scene, space, arc)] for page in self.pages())

    def is_doubted(self, layout: Layout, arc: Arc) -> bool:
        """Whether anything of this layout in the arc may be unsettled without being pending."""
        return any(doubt.layout == layout and doubt.arc.intersection(arc) is not None for doubt in self.doubts)

    def within(self, piece: Arc) -> bool:
        """Whether anything in a piece may be unsettled: then it must not be given away."""
        if self.is_quiet:
            return False
        if not self.is_read or any(doubt.arc.intersection(piece) is not None for doubt in self.doubts):
            return True
        if piece.first == piece.last:
            return piece.first in self._homes
        return any(home in piece for home in self._homes)

    async def until(self, is_so: Callable[[], bool]) -> None:
        """Return once that is so; looked at again whenever something here has changed but what is pending."""
        while not is_so():
            await self._changed.wait()

    # ---------------------------------------------------------------------------------------------------- changes

    def add(self, pending: Pending, *, is_oldest: bool = False) -> None:
        """Before it is given to the store: nobody must see it there and not here."""
        found = self._by_name.setdefault(name_of(pending.spot), [])
        if not found:
            self._homes[pending.home] += 1
        found.insert(0 if is_oldest else len(found), pending)
        self._count += 1

    def settle(self, pending: Pending) -> list[Pending]:
        """It may be told, and with it all older versions, which nobody can miss any more. What is settled by that."""
        name = name_of(pending.spot)
        found = self._by_name.get(name, [])
        if pending not in found:
            return []
        index = found.index(pending) + 1
        self._keep(name, found, found[index:])
        for one in found[:index]:
            _finish(one)
        return found[:index]

    def drop(self, pending: Pending) -> None:
        """It was not stored after all."""
        name = name_of(pending.spot)
        found = self._by_name.get(name, [])
        self._keep(name, found, [one for one in found if one is not pending])
        _finish(pending)

    def doubt(self, doubt: Doubt) -> None:
        same = [known for known in self.doubts if known.layout == doubt.layout and known.rules >= doubt.rules]
        if not any(known.arc.first <= doubt.arc.first and doubt.arc.last <= known.arc.last for known in same):
            self.doubts = (*self.doubts, doubt)

    def clear(self, layout: Layout, arc: Arc, rules: int) -> None:
        """All of this arc satisfies these rules: doubts that ask for no more end there."""
        kept: list[Doubt] = []
        for doubt in self.doubts:
            if doubt.layout == layout and doubt.rules <= rules and doubt.arc.intersection(arc) is not None:
                kept += [doubt._replace(arc=rest) for rest in without(doubt.arc, arc)]
            else:
                kept.append(doubt)
        if tuple(kept) != self.doubts:
            self.doubts = tuple(kept)
            self._announce()

    def read_all(self) -> None:
        """What was owed at the start is pending now, as far as it is unsettled."""
        self.is_read = True
        self._announce()

    def _keep(self, name: Name, found: list[Pending], left: list[Pending]) -> None:
        self._count -= len(found) - len(left)
        if left:
            self._by_name[name] = left
        elif self._by_name.pop(name, None):
            home = found[0].home
            self._homes[home] -= 1
            if not self._homes[home]:
                del self._homes[home]

    def _announce(self) -> None:
        self._changed.set()
        self._changed = trio.Event()


async def first_unsettled(pendings: Sequence[Pending], until: float) -> Pending | None:
    """The first of these that is not settled by then (Trio's time); None once all are."""
    for pending in pendings:
        if not pending.is_settled:
            with trio.CancelScope(deadline=until):
                await pending.wait()
            if not pending.is_settled:
                return pending
    return None


def _is_listed(spot: Spot, scene: SceneId, space: SpaceId, arc: Arc) -> bool:
    return spot.place[:2] == (scene, space) and (spot.place.location in arc or spot.home in arc)


def _finish(pending: Pending) -> None:
    pending.is_settled = True
    if pending.settled is not None:
        pending.settled.set()
