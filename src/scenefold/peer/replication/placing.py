"""Who shall hold copies of this node's arc: placement as it is believed, watched, and kept once it has lasted (specs/20-copies.md, Placement).

A layout counts as soon as any scene that this node knows has it, whether there are records or not: who writes first finds holders.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import trio

from scenefold.base.cover import runs, without
from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import Arc, Location
from scenefold.base.placement import Layout, Line
from scenefold.base.prefixes import forbids
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import Segment
from scenefold.peer.line.gaps import GAP_REST_S, Gaps
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.replication.forbidden_holders import with_forbidden
from scenefold.peer.replication.full_holders import FullHolders, around_full
from scenefold.peer.replication.placing_wishes import (
    Piece,
    Shortage,
    Urgency,
    Wish,
    lasting,
    most_needed,
    needed_of,
    pieces_of,
    ripe,
    shortage_of,
    target_of,
)
from scenefold.peer.routing import claims_of
from scenefold.wire import Member

LOOK_S = 1.0
"""Between two looks at who claims what, while nobody waits."""
GATHER_S = 60.0
"""Between two looks at whether neighbours have become alike."""
PLACE_S_MAX = 10.0
"""For a write that comes before the first placement."""

_log = logging.getLogger("scenefold.peer.replication")


class Placing:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster, gaps: Gaps) -> None:
        """`gaps`: what of the line has no owner, and changes placement when it has one."""
        self._parts = parts
        self._gaps = gaps
        self._roster = roster
        self._wake = trio.Event()
        self._gathered_at = parts.world.clock.now()
        self._line_of: tuple[object, ...] = ()
        self._line = Line(())
        self._given_of: tuple[object, ...] = ()
        self._given: dict[Layout, list[Piece]] = {}
        self._wishes: dict[Layout, list[Wish]] = {}
        self.full = FullHolders(parts.world.clock, roster)
        """Who has no room for copies."""
        self.layouts: dict[Layout, int] = {}
        """All that the known scenes have, and what their configurations ask of every write."""
        self._most: dict[Layout, int] = {}
        self.shortages: dict[Layout, Shortage] = {}
        """Layouts that are degraded: fewer nodes may hold copies than they have shadows."""

    # ------------------------------------------------------------------------------------------------- questions

    def layout_of(self, scene: KnownScene, space: SpaceId) -> Layout:
        """() for a space that has one copy."""
        return scene.layouts.get(space, ())

    def needed_of(self, scene: KnownScene, space: SpaceId) -> int:
        """How many nodes must have a record of the space before a write counts, the owner among them."""
        return min(scene.needed.get(space, 1), max(1, len(self._parts.cluster_log.registry.order)))

    def segment_of(self, scene: KnownScene, space: SpaceId, home: Location) -> Segment | None:
        """Who holds copies of a place of the space; None if it has none, or nobody was placed yet."""
        layout = self.layout_of(scene, space)
        return self._parts.keeper.copies.configurations.at(layout, home) if layout else None

    def check(self, scene: KnownScene, space: SpaceId) -> None:
        """Refused (22) if so few nodes may hold copies of the space that no write can count; 16 if who has joined since was not looked at yet."""
        short = self.shortages.get(self.layout_of(scene, space))
        if short is None or short.possible >= self.needed_of(scene, space):
            return
        if self._line_of and self._line_of[0] != self._parts.cluster_log.registry.position:
            self._wake.set()
            raise Refused(RejectReason.NOT_READY, "who is to hold copies is being looked at", remedy="try again in a while")
        raise too_few(short)

    async def ensure_placed(self, layout: Layout) -> None:
        """Return once all of the arc has holders by this layout, or is about to. Refused (16) if that takes too long."""
        keeper = self._parts.keeper
        with trio.move_on_after(PLACE_S_MAX):
            while True:
                seen = keeper.copies
                if self._is_placed(layout):
                    return
                self._wake.set()
                await keeper.copies_changed_after(seen)
        raise Refused(RejectReason.NOT_READY, "who is to hold copies there is not settled yet", remedy="try again in a while")

    def look_soon(self) -> None:
        """There is something to place that was not there at the last look."""
        self._wake.set()

    def _is_placed(self, layout: Layout) -> bool:
        copies, arc = self._parts.keeper.copies, self._parts.keeper.holding.arc
        if not layout or arc is None:
            return True
        rest = [arc]
        for segment in copies.configurations.segments:
            if segment.layout == layout and target_of(segment, copies.configurations.me) is not None:
                rest = [left for part in rest for left in without(part, segment.arc)]
        return not rest

    # --------------------------------------------------------------------------------------------------- running

    async def run(self) -> None:
        """Watch until cancelled."""
        while True:
            # Before the look: whoever asks for one meanwhile gets another.
            self._wake = trio.Event()
            try:
                await self._look()
            except Refused as refusal:
                # The disk is full, this life is ending, or the arc falls into too many pieces.
                self._parts.events["copies not placed"] += 1
                _log.debug("who holds copies is placed again later: %s", refusal)
            with trio.move_on_after(LOOK_S):
                await self._wake.wait()

    async def _look(self) -> None:
        parts = self._parts
        registry, arc = parts.cluster_log.registry, parts.keeper.holding.arc
        self.layouts = needed_of(parts.scenes.everyone(), len(registry.order))
        self._most = most_needed(parts.scenes.everyone(), len(registry.order))
        wanted = {**dict.fromkeys(await self._former(), 1), **self.layouts}
        if arc is None or not wanted or not registry.is_current(parts.own.member):
            self._wishes, self._given, self._given_of, self.shortages = {}, {}, (), {}
            return
        before = self.shortages
        self._give(arc, wanted)
        now, configurations = parts.world.clock.now(), parts.keeper.copies.configurations
        self._wishes = {
            layout: lasting(self._wishes.get(layout, ()), pieces, wanted[layout], now) for layout, pieces in self._given.items()
        }
        urgent = self._urgent() if self._gaps.unowned(arc, GAP_REST_S) else {}
        ready = [
            (layout, ripe(configurations, layout, wishes, now, parts.keeper.is_removed, urgent.get(layout), self._is_forbidden))
            for layout, wishes in self._wishes.items()
        ]
        due = [(layout, pieces, wanted[layout]) for layout, pieces in ready if pieces]
        if due:
            # Where too few were allowed no write may count before those that are have taken the place of the others.
            after, self.shortages = (
                self.shortages,
                {**self.shortages, **{key: short for key, short in before.items() if short.forbids_writes}},
            )
            try:
                await parts.keeper.change_copies(partial(_placed, due))
            finally:
                self.shortages = after
            parts.events["copies placed"] += len(due)
        elif now - self._gathered_at >= GATHER_S:
            self._gathered_at = now
            if configurations.gather() is not configurations:
                await parts.keeper.change_copies(lambda copies, _holding: replace(copies, configurations=copies.configurations.gather()))

    def _give(self, arc: Arc, wanted: Mapping[Layout, int]) -> None:
        """What placement gives by now for each layout; looked up anew if something has changed."""
        registry, own = self._parts.cluster_log.registry, self._parts.own
        self._look_at_line()
        copies = self._parts.keeper.copies
        places = _recovered(copies, arc)
        full = self._full()
        # Whom these ask for depends on who holds what already.
        has_exceptions = full or any(short.whose is not None and short.forbids_writes for short in self.shortages.values())
        segments = copies.configurations.segments if has_exceptions else ()
        about = self._line_of, own.blacklist, tuple(places), wanted, self._most, full, segments
        if about == self._given_of:
            return
        takable = {node: known.member for node in registry.order if node != own.me and (known := registry.current(node)) is not None}
        allowed = {node: found for node, found in takable.items() if not forbids(own.blacklist.prefixes, node, owner=own.me)}
        waiting = sum(node in allowed for node in self._line.waiting)
        self._given, shortages = {}, {}
        for layout, needed in wanted.items():
            if layout not in self.layouts:
                self._given[layout] = [(place, ()) for place in places]
                continue
            most = self._most[layout]
            pieces = partial(self._pieces, layout, most)
            given = [piece for place in places for piece in around_full(copies.configurations, layout, place, allowed, full, pieces)]
            short = shortage_of(layout, needed, allowed.keys(), takable.keys(), own.me, waiting, most)
            if short is not None:
                shortages[layout] = short
                if short.whose is not None and short.forbids_writes:
                    given = with_forbidden(copies.configurations, layout, given, takable)
            self._given[layout] = runs(given)
        self.shortages, self._given_of = shortages, about

    def _pieces(self, layout: Layout, most: int, place: Arc, allowed: Mapping[NodeId, Member]) -> list[Piece]:
        order = self._parts.cluster_log.registry.order
        return pieces_of(self._line, self._parts.own.me, layout, [place], allowed, order, most)

    def _is_forbidden(self, member: Member) -> bool:
        return forbids(self._parts.own.blacklist.prefixes, member.node, owner=self._parts.own.me)

    def _urgent(self) -> dict[Layout, Urgency]:
        """What is not put off. Two of each record are wanted at once, whatever writes ask for, of who can be given copies as far as is known."""
        full = self._full()

        def is_there(member: Member) -> bool:
            return member not in full and self._roster.is_believed_alive(member.node)

        return {layout: Urgency(max(2, self._most.get(layout, 1)), is_there) for layout in self._wishes}

    def _full(self) -> frozenset[Member]:
        registry = self._parts.cluster_log.registry
        return self.full.among(known.member for node in registry.order if (known := registry.current(node)) is not None)

    def _look_at_line(self) -> None:
        """Who claims what, as this node believes; made anew if that has changed."""
        registry, own = self._parts.cluster_log.registry, self._parts.own
        about = registry.position, self._roster.arcs_version, own.arc
        if about != self._line_of:
            claims = claims_of(registry, self._roster.arcs(), own.me, own.arc)
            self._line, self._line_of = Line([*((node, None) for node in registry.order), *((node, arc) for arc, node in claims)]), about

    async def _former(self) -> list[Layout]:
        """Layouts that nothing has any more, though copies are held by them. None as long as a scene of records here is unknown."""
        held = {segment.layout for segment in self._parts.keeper.copies.configurations.segments}
        if held <= self.layouts.keys():
            return []
        known = {scene.public.scene for scene in self._parts.scenes.everyone()}
        if any(scene not in known for scene, _ in await self._parts.store.spaces()):
            return []
        return sorted(held - self.layouts.keys())


def too_few(short: Shortage) -> Refused:
    """Why nothing is written in a space of that layout."""
    remedy = "add nodes" if short.whose is None else "add nodes, or take something off that blacklist"
    return Refused(RejectReason.TOO_FEW_COPIES, f"no write can count here: {short}", remedy=remedy)


def _recovered(copies: Copies, arc: Arc) -> list[Arc]:
    """The arc without what is being recovered: who holds copies there is to be heard first."""
    rest = [arc]
    for gap in copies.unrecovered:
        rest = [left for part in rest for left in without(part, gap)]
    return rest


def _placed(due: Iterable[tuple[Layout, Sequence[Piece], int]], copies: Copies, holding: Holding) -> Copies:
    """With these holders wherever this node still owns the place, and knows what was acknowledged."""
    places = [] if holding.arc is None else _recovered(copies, holding.arc)
    configurations = copies.configurations
    for layout, pieces, needed in due:
        inside = [(common, holders) for arc, holders in pieces for place in places if (common := arc.intersection(place)) is not None]
        configurations = configurations.place(layout, inside, needed)
    return copies if configurations is copies.configurations else replace(copies, configurations=configurations)
