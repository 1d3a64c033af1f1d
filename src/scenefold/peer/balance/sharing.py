"""A neighbour without an arc asks for a part of ours: AskRange (68) (specs/13-balance.md, Joining)."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.balance.barred import Barred
from scenefold.peer.balance.pieces import Scales, half_of, one_at, up_to
from scenefold.peer.balance.seams import HasRegistry, MovesBounds
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.line.ends import Side, touches
from scenefold.peer.line.gaps import Gaps
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import AskRange, HandoverReply

NO_HANDOVER = bytes(16)

_log = logging.getLogger("scenefold.peer.sharing")


@dataclass(frozen=True, slots=True)
class _Promise:
    side: Side
    piece: Arc
    receiver: NodeId


class Sharing:
    """Answers AskRange, and gives what it promised, one piece at a time."""

    def __init__(self, store: Scales, line: MovesBounds, log: HasRegistry, own: OwnStatus, roster: Roster, gaps: Gaps) -> None:
        self._store = store
        self._line = line
        self._log = log
        self._own = own
        self._roster = roster
        self._barred = Barred(roster, log, own)
        self._gaps = gaps
        self._promised, self._promises = trio.open_memory_channel[_Promise](1)
        self._giving_to: NodeId | None = None

    def register(self, handlers: Handlers) -> None:
        handlers.add(AskRange, self._on_ask, senders=Senders.NODES)

    async def run(self) -> None:
        """Give what was promised, until cancelled."""
        async for promise in self._promises:
            self._giving_to = promise.receiver
            try:
                await self._line.give(promise.side, promise.piece, why="a newcomer asked for it")
            except (Refused, Unreachable, PeerFault) as problem:
                # It asks again.
                _log.info("%s gets nothing for now: %s", address_of(promise.receiver), problem)
            finally:
                self._giving_to = None

    async def _on_ask(self, packet: AskRange, peer: str) -> HandoverReply:
        try:
            await self._promise(packet, peer)
        except Refused as refusal:
            return HandoverReply(NO_HANDOVER, refusal.reason, refusal.what)
        return HandoverReply(NO_HANDOVER, 0, "")

    async def _promise(self, packet: AskRange, peer: str) -> None:
        receiver = packet.receiver
        if node_of(peer) != receiver.node:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} asks for node {receiver.node}")
        side = self._side_of(receiver.node)
        if not self._log.registry.is_current(receiver):
            raise Refused(RejectReason.WRONG_INCARNATION, "another incarnation of the node is registered here")
        if self._giving_to == receiver.node:
            # It did not hear our promise.
            return
        if self._roster.arcs().get(receiver.node) is not None:
            # By itself nobody may draw what others hold: that is for balance to say.
            raise _busy(f"{peer} owns something already, as far as is known here")
        if self._line.refuses:
            raise _busy(self._line.refuses)
        if self._line.busy(side) or self._giving_to is not None:
            raise _busy("another piece is on its way")
        is_beside_gap = any(touches(gap, arc, side) for gap in self._gaps.unowned(arc)) if (arc := self._line.arc) is not None else False
        if is_beside_gap and side is Side.RIGHT:
            raise _busy("what lies between has no owner, and is adopted from its right")
        may_write = receiver.node not in self._barred.now()
        piece = await self._piece(side, packet.place, is_beside_gap=is_beside_gap, may_write=may_write)
        if piece is None:
            raise Refused(RejectReason.OUTSIDE_BOUNDS, f"{address_of(self._own.me)} owns nothing that it could part with")
        if not self._line.settled(piece):
            raise _busy("what lies here has come a moment ago, or its giver has not done with it")
        try:
            self._promised.send_nowait(_Promise(side, piece, receiver.node))
        except trio.WouldBlock:
            raise _busy("another piece has been promised") from None

    def _side_of(self, receiver: NodeId) -> Side:
        registry = self._log.registry
        left, right = registry.neighbours(self._own.me) if registry.stands(self._own.me) else (None, None)
        if receiver == left:
            return Side.LEFT
        if receiver == right:
            return Side.RIGHT
        # One of the two logs is behind.
        raise Refused(
            RejectReason.NOT_READY, f"{address_of(receiver)} is no neighbour of {address_of(self._own.me)} in the log as known here"
        )

    async def _piece(self, side: Side, place: Location | None, *, is_beside_gap: bool, may_write: bool) -> Arc | None:
        arc = self._line.arc
        if arc is None or (is_beside_gap and arc.length == 1):
            return None
        if is_beside_gap and place is None:
            # By that it stands right of what nobody owns, and adopts it.
            return Arc(arc.first, arc.first)
        if not may_write:
            # So it stands on the line, and is given more as soon as its blacklist allows.
            return one_at(arc, side)
        wanted = None if place is None else up_to(arc, side, place)
        return wanted if wanted is not None else await half_of(self._store, arc, side)


def _busy(what: str) -> Refused:
    return Refused(RejectReason.BUSY, what)
