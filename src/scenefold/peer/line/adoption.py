"""The shell of adoption: wait, ask, adopt; and the answers to others that ask (specs/12-line.md, Adoption)."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import FIRST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.line.ends import Side, is_end_of, touches
from scenefold.peer.line.gaps import Gaps, share_of
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.line.rules import Bound, bound_for
from scenefold.peer.line.sightings import Sightings
from scenefold.peer.line.survey import Survey, Unsettled, surveys
from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import BoundConfirmed, ConfirmBound, Member, Packet
from scenefold.world import Priority

ASK_S_MAX = 5.0
PASS_S_MAX = 15.0
"""For a neighbour without an arc to get the place by which it adopts its share of a gap; then this node adopts all of it."""

Give = Callable[..., Awaitable[None]]
"""Line.give."""

_log = logging.getLogger("scenefold.peer.line")


class Adoption:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, gaps: Gaps | None, give: Give) -> None:
        """`gaps`: who owned what before it had no owner; None: nobody knows. `give`: how a place is handed to a neighbour."""
        self._parts = parts
        self._gaps = gaps
        self._give = give
        self._edge: Arc | None = None
        """The place by which the neighbour on the left is to adopt the rest of a gap."""
        self._in_vain: Member | None = None
        """Who did not get it."""
        self._surveyed: tuple[int, Arc | None] | None = None
        self._sightings = Sightings()
        self.gap: Arc | None = None
        """A gap that was found and is not adopted yet."""

    def register(self, handlers: Handlers) -> None:
        handlers.add(ConfirmBound, self._on_confirm, senders=Senders.NODES)

    async def run(self) -> None:
        """Look for gaps whenever somebody was removed, or our arc was born or moved, until cancelled."""
        parts = self._parts
        pauses = Pauses(parts.world)
        while True:
            registry = parts.cluster_log.registry
            holding = parts.keeper.holding
            if not registry.is_current(parts.own.member):
                await parts.cluster_log.changed_after(registry.position)
                continue
            about = (registry.left_at, holding.arc)
            if about == self._surveyed:
                await parts.something_new(holding.revision, registry.position)
                continue
            await parts.world.clock.sleep(self._wait_s(registry))
            try:
                await self._look()
                self._surveyed = about
                pauses.reset()
                if self._edge is not None:
                    await self._pass_on(self._edge)
            except (Unsettled, Refused, Unreachable, PeerFault) as problem:
                _log.debug("a gap is looked for again: %s", problem)
                await pauses.wait()

    def _wait_s(self, registry: Registry) -> float:
        """Until the leases of all who were removed are over."""
        if not registry.left_at:
            return 0.0
        return self._parts.leases_end_in_s(registry.left_at)

    async def _look(self) -> None:
        parts = self._parts
        self._edge = None
        parts.require_lease()
        # Drops, durably, what the log has ended.
        holding = await parts.keeper.change(lambda now: now)
        registry = parts.cluster_log.registry
        for survey in surveys(holding, registry, parts.own.me):
            gap = await self._found(survey, registry)
            if gap is None:
                continue
            self.gap = gap
            gap = self._without_leases(gap, holding, registry)
            # Whoever was asked may have said too little: then it would be another's.
            await parts.claims.look(gap, holding.arc)
            parts.require_lease()
            if parts.cluster_log.registry.position != registry.position:
                raise Unsettled("the log has changed meanwhile")
            share = self._share_of(gap, holding)
            holding = await self._adopt(share, holding)
            if share != gap:
                # A change of its own, so that it is recovered apart, and soon.
                before = Location.from_number(share.first.number - 1)
                holding = await self._adopt(Arc(before, before), holding)
                self._edge = Arc(before, before)
                # The other side is looked at once that has passed: what stops this there would have another share taken here.
                break
        self.gap = None

    async def _adopt(self, gap: Arc, holding: Holding) -> Holding:
        parts, revision = self._parts, holding.revision

        def adopt(now: Holding) -> Holding:
            parts.claims.require_free(gap, now.arc)
            return now.adopt(gap, revision=revision)

        after = await parts.keeper.change(adopt)
        parts.events["adopted"] += 1
        _log.warning("the arc %s..%s had no owner any more: it is this node's now", gap.first.hex()[:8], gap.last.hex()[:8])
        return after

    def _share_of(self, gap: Arc, holding: Holding) -> Arc:
        """All of it, but for what neighbours without an arc are to adopt, who stand between it and this node."""
        parts = self._parts
        if holding.arc is None or not touches(gap, holding.arc, Side.LEFT):
            return gap
        waiting = parts.claims.waiting_left(parts.own.me)
        known = None if not waiting else parts.cluster_log.registry.current(waiting[0])
        if known is None or known.member == self._in_vain:
            return gap
        return share_of(gap, len(waiting), () if self._gaps is None else self._gaps.former())

    async def _pass_on(self, edge: Arc) -> None:
        """Give the neighbour the place right of what is left, once it is known what was acknowledged there. Then that node is responsible."""
        parts, self._edge = self._parts, None
        clock, pauses = parts.world.clock, Pauses(parts.world)
        deadline = clock.now() + PASS_S_MAX
        waiting = parts.claims.waiting_left(parts.own.me)
        known = parts.cluster_log.registry.current(waiting[0]) if waiting else None
        while known is not None and clock.now() < deadline:
            arc = parts.keeper.holding.arc
            if arc is None or not is_end_of(edge, arc, Side.LEFT):
                # It has asked for it, and got it.
                return
            try:
                await self._give(Side.LEFT, edge, "what is left of a gap is its receiver's to adopt")
            except (Refused, Unreachable, PeerFault) as problem:
                _log.debug("no share of a gap is passed on yet: %s", problem)
                await pauses.wait()
            else:
                return
        self._in_vain = None if known is None else known.member

    def _without_leases(self, gap: Arc, holding: Holding, registry: Registry) -> Arc:
        """What of the gap nobody holds a lease for any more, whoever was removed meanwhile; Unsettled if that is nothing yet."""
        wait_s = self._wait_s(registry)
        if holding.arc is not None:
            now = self._parts.world.clock.now()
            seen = self._sightings.see(gap, holding.revision, now)
            if wait_s and now - seen.moment >= T_WAIT_S:
                return seen.gap
        if wait_s:
            raise Unsettled("somebody was removed meanwhile")
        return gap

    async def _found(self, survey: Survey, registry: Registry) -> Arc | None:
        """Play a survey to its end."""
        try:
            node = next(survey)
            while True:
                node = survey.send(await self._ask(node, registry))
        except StopIteration as end:
            gap: Arc | None = end.value
            return gap

    async def _ask(self, node: NodeId, registry: Registry) -> Bound:
        parts = self._parts
        arc = parts.keeper.holding.arc
        request = ConfirmBound(parts.own.member, registry.position, FIRST if arc is None else arc.first)
        reply = await parts.peers.ask(node, Priority.LOW, request, BoundConfirmed, ASK_S_MAX)
        if reply.reason or reply.log_position != registry.position:
            if reply.log_position > registry.position:
                await parts.cluster_log.pull_from(node)
            raise Unsettled(f"{address_of(node)} does not confirm its bound (reason {reply.reason}, log {reply.log_position})")
        return Bound(reply.right_bound, reply.revision, reply.pending)

    # -------------------------------------------------------------------------------------------------- handler

    async def _on_confirm(self, packet: ConfirmBound, peer: str) -> Packet:
        parts = self._parts
        try:
            if node_of(peer) != packet.asker.node:
                raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} asks in the name of {address_of(packet.asker.node)}")
            if parts.cluster_log.registry.position < packet.log_position:
                await parts.cluster_log.pull_from(packet.asker.node)
            await parts.keeper.change(lambda now: now)
            async with parts.keeper.unchanging() as holding:
                parts.require_lease()
                registry = parts.cluster_log.registry
                if holding.drop_removed(parts.keeper.is_removed) != holding:
                    raise Refused(RejectReason.POSITION_BEHIND, "the log has gone on here")
                bound = bound_for(holding, registry, parts.own.member, packet.asker, packet.log_position)
        except Refused as refusal:
            _log.debug("no bound is confirmed to %s: %s", peer, refusal)
            return BoundConfirmed(int(refusal.reason), None, False, parts.cluster_log.registry.position, 0)
        return BoundConfirmed(0, bound.right_bound, bound.is_open, packet.log_position, bound.revision)
