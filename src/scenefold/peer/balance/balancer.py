"""Looks every second whether a piece of the own arc should go to a neighbour, and gives it (specs/13-balance.md).

What to give says the policy, from the table of all; which piece, the store; how, the line. This is the hand between them: it
keeps the news, waits while a side is busy or its records have not settled, and stays away for a while from a neighbour that
refused. It can be paused, and says what it did.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.peer.balance.barred import BARRED_REST_S, Barred
from scenefold.peer.balance.news import News
from scenefold.peer.balance.pieces import PIECE_BYTES_MAX, Piece, Scales, all_but_one, one_at, piece_of
from scenefold.peer.balance.policy import BYTES_MIN, Give, NodeFill, gives, the_rest
from scenefold.peer.balance.seams import HasRegistry, MovesBounds, fill_of
from scenefold.peer.line.ends import Side
from scenefold.peer.line.gaps import GAP_REST_S, Gaps, beside
from scenefold.peer.line.resting import Resting
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import TELL_S, OwnStatus
from scenefold.world import QuietLog, World

LOOK_S = 1.0
"""Between two looks: a handover takes about as long."""
NODES_A_LOOK = 64
"""Among more, looks are rarer by as much: each goes through all of them, and their news come more slowly, too."""
RELAY_S = 10.0
"""A status that others pass on is usually not older: the table goes round in about that time in a cluster of fifty."""
TOLD_S = 5.0
"""A fill that has changed is measured and told within it, if few nodes are to be told."""
REFUSED_S_MIN, REFUSED_S_MAX = 5.0, 60.0
"""How long a neighbour that refused is left alone: twice as long each time."""
HALVINGS_MAX = 3
"""A piece in which something has not settled is halved so often; then it is waited for."""

_log = logging.getLogger("scenefold.peer.balance")


@dataclass(slots=True)
class _SideState:
    under_way: bool = False
    again_at: float = 0.0
    pause_s: float = REFUSED_S_MIN
    peer: NodeId | None = None
    refused: bool = False


@dataclass(slots=True)
class Given:
    """What this node has given since its start."""

    handovers: int = 0
    records: int = 0
    bytes: int = 0


class Balancer:
    """Used from the Trio thread only. It may be paused at any time; what is under way ends as it would."""

    def __init__(
        self,
        world: World,
        store: Scales,
        line: MovesBounds,
        roster: Roster,
        log: HasRegistry,
        own: OwnStatus,
        resting: Resting,
        gaps: Gaps,
        *,
        is_off: bool = False,
    ) -> None:
        """`resting`: whether it is paused. `gaps`: what of the line has no owner. `is_off`: it gives nothing as long as this process runs, whatever `resting` says."""
        self._world = world
        self._store = store
        self._line = line
        self._roster = roster
        self._log = log
        self._own = own
        self._resting = resting
        self._gaps = gaps
        self._is_off = is_off
        self._barred = Barred(roster, log, own)
        self._barred_since: float | None = None
        self.given = Given()
        self._news = News(own.me, RELAY_S)
        self._sides = {side: _SideState() for side in Side}
        self._arc: Arc | None = None
        self._wanted: list[Give] = []
        self._quiet = QuietLog(_log, logging.INFO)

    async def run(self) -> None:
        """Look until cancelled."""
        self._arc = self._line.arc
        async with trio.open_nursery() as nursery:
            while True:
                await self._world.clock.sleep(LOOK_S * max(1.0, len(self._log.registry.order) / NODES_A_LOOK))
                for give in await self.look():
                    nursery.start_soon(self._give, give)

    def report(self) -> dict[str, Any]:
        """For people: what was given, and what is to be."""
        return {
            "paused": self._is_paused(),
            "handovers": self.given.handovers,
            "records": self.given.records,
            "bytes": self.given.bytes,
            "to_give": {str(give.side): give.bytes for give in self._wanted},
        }

    async def look(self) -> list[Give]:
        """Take the news, and say what can be given now."""
        await self._book_received()
        now = self._world.clock.now()
        nodes = self._take_news(now)
        self._wanted = []
        if self._own.me not in nodes or self._line.arc is None:
            return []
        me = nodes.index(self._own.me)
        neighbours = {Side.LEFT: nodes[me - 1] if me else None, Side.RIGHT: nodes[me + 1] if me + 1 < len(nodes) else None}
        for side, state in self._sides.items():
            if state.peer != neighbours[side]:
                self._sides[side] = _SideState(state.under_way, peer=neighbours[side])
        if self._gaps.unowned(self._line.arc, GAP_REST_S):
            # Soon somebody has it, and before that nobody's share is what it will be.
            return []
        waiting = self._beside_gaps(nodes)
        if self._own.me in waiting:
            return []
        barred = self._barred.now()
        fills = [self._fill(node, now, may_take=node not in waiting and node not in barred) for node in nodes]
        if self._own.me in barred:
            self._wanted = await self._everything(self._line.arc, fills, me, now)
        else:
            self._barred_since = None
            self._wanted = gives(fills, me, self._news.changes(nodes, now - TOLD_S - len(nodes) * TELL_S))
        if self._is_paused() or self._line.refuses:
            return []
        return [give for give in self._wanted if self._may(give.side, now)]

    async def _everything(self, arc: Arc, fills: Sequence[NodeFill], me: int, now: float) -> list[Give]:
        """What goes to one neighbour, since this node shall own nothing: the one location that it keeps at last holds no record, if possible."""
        if self._barred_since is None:
            self._barred_since = now
        if now - self._barred_since < BARRED_REST_S:
            return []
        for give in (found := the_rest(fills, me)):
            kept = one_at(arc, give.side.opposite)
            if kept is None:
                return []
            if not (await self._store.arc_totals(kept)).records:
                return [give]
        return found[:1]

    def _beside_gaps(self, nodes: tuple[NodeId, ...]) -> frozenset[NodeId]:
        """Who stands where nobody owns the line any more: one of them is about to adopt that, and has more than it seems."""
        gaps = self._gaps.unowned(self._line.arc)
        return beside(gaps, nodes, {**self._roster.arcs(), self._own.me: self._line.arc}) if gaps else frozenset()

    def _is_paused(self) -> bool:
        return self._is_off or self._resting.balance

    def _may(self, side: Side, now: float) -> bool:
        state = self._sides[side]
        return not state.under_way and now >= state.again_at and not self._line.busy(side)

    def _take_news(self, now: float) -> tuple[NodeId, ...]:
        """What was heard since the last look; answers the nodes in the order of the line."""
        nodes = self._log.registry.order
        self._news.keep_only(nodes)
        for node in nodes:
            status = self._roster.status(node)
            if status is not None:
                self._news.hear(node, status.lamport, *fill_of(status), now, incarnation=status.incarnation)
        self._news.measure(*self._own.fill, now)
        return nodes

    def _fill(self, node: NodeId, now: float, *, may_take: bool) -> NodeFill:
        if node == self._own.me:
            return self._news.fill(node, takes=True)
        shy = any(state.refused and now < state.again_at and state.peer == node for state in self._sides.values())
        is_there = self._log.registry.current(node) is not None and self._roster.is_believed_alive(node)
        return self._news.fill(node, takes=is_there and may_take and not shy)

    async def _book_received(self) -> None:
        """An arc that has grown since the last look brought something from the neighbour on that side."""
        before, after = self._arc, self._line.arc
        self._arc = after
        if before is None or after is None or before == after:
            return
        left, right = self._neighbours()
        if after.first < before.first and left is not None:
            await self._book(left, Arc(after.first, _before(before.first)))
        behind = before.last.next()
        if after.last > before.last and right is not None and behind is not None:
            await self._book(right, Arc(behind, after.last))

    async def _book(self, giver: NodeId, grown: Arc) -> None:
        totals = await self._store.arc_totals(grown)
        self._news.book(giver, self._own.me, int(totals.bytes / await self._density()))

    async def _density(self) -> float:
        """Bytes of records for each byte of disk: the rest are page ends, tables and keys."""
        statistics = await self._store.statistics()
        if not 0 < statistics.bytes < statistics.disk_used_bytes:
            return 1.0
        return statistics.bytes / statistics.disk_used_bytes

    def _neighbours(self) -> tuple[NodeId | None, NodeId | None]:
        registry = self._log.registry
        return registry.neighbours(self._own.me) if registry.stands(self._own.me) else (None, None)

    async def _give(self, give: Give) -> None:
        state = self._sides[give.side]
        peer = state.peer
        state.under_way = True
        try:
            density = await self._density()
            piece = await self._settled_piece(give.side, min(int(give.bytes * density), PIECE_BYTES_MAX), may_be_all=give.is_rest)
            if piece is None or peer is None:
                return
            why = f"balance: {give.bytes} bytes too many on this side of the bound"
            if give.is_rest:
                why = "the blacklist of its owner allows no other node to hold copies"
            await self._line.give(give.side, piece.arc, why=why)
        except (Refused, Unreachable, PeerFault) as problem:
            self._stay_away(give.side, problem)
        else:
            self._note_given(peer, give.side, piece, density)
        finally:
            self._sides[give.side].under_way = False

    async def _settled_piece(self, side: Side, size: int, *, may_be_all: bool) -> Piece | None:
        """The piece to give; smaller if a part of it has come too recently. `may_be_all`: if all lies in it, then all of the arc but one location."""
        arc = self._line.arc
        for _ in range(HALVINGS_MAX):
            if arc is None or (size <= 0 and not may_be_all):
                return None
            piece = await piece_of(self._store, arc, side, size)
            if piece is None and may_be_all:
                piece = await all_but_one(self._store, arc, side)
            # One place may hold much more than was asked for: giving it would only turn the need round.
            if piece is None or piece.bytes > 2 * max(size, BYTES_MIN):
                return None
            if self._line.settled(piece.arc):
                return piece
            size //= 2
        return None

    def _note_given(self, peer: NodeId, side: Side, piece: Piece, density: float) -> None:
        self._news.book(self._own.me, peer, int(piece.bytes / density))
        self.given.handovers += 1
        self.given.records += piece.records
        self.given.bytes += piece.bytes
        state = self._sides[side]
        state.pause_s, state.refused = REFUSED_S_MIN, False
        # By then the own fill has been measured again.
        state.again_at = self._world.clock.now() + 2 * LOOK_S
        _log.info("gave %d records, %d bytes, to %s", piece.records, piece.bytes, address_of(peer))

    def _stay_away(self, side: Side, problem: Exception) -> None:
        state = self._sides[side]
        now = self._world.clock.now()
        state.again_at = now + state.pause_s
        state.refused = state.pause_s > REFUSED_S_MIN
        state.pause_s = min(2 * state.pause_s, REFUSED_S_MAX)
        self._quiet.say(now, "balance", str(side), f"nothing goes {side} for now: {problem}")


def _before(location: Location) -> Location:
    return Location.from_number(location.number - 1)
