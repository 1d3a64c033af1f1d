"""How a newcomer gets its first arc: it chooses a place, registers there, and asks its neighbours (specs/13-balance.md).

The place in the order is decided once, by the log entry that makes it a member. From then on it has two neighbours, and
asks the right one for its left half, else the left one for its right half, until it owns something. So it does not
matter who dies, is full or busy, or who else joins at the same place: neighbours change by the log, and are asked again.
Dying itself at any step leaves nothing undone: without an arc a node owes nothing, and what was on its way to it is the
handover's business.
"""

from __future__ import annotations

import logging
from typing import Protocol

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import LOCATION_BYTES, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.balance.places import Host, most_loaded, owner_of
from scenefold.peer.balance.seams import Log, MovesBounds, fill_of
from scenefold.peer.enrolment.enrolment import registration
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.wire import AskRange, HandoverReply
from scenefold.world import Priority, QuietLog, World

TABLE_S_MAX = 5.0
"""For the statuses of most members to be heard before a place is chosen; then it is chosen among those that are known."""
ASK_S_MAX = 5.0
"""For a neighbour to say whether it will give something."""
LOOK_S = 0.5
"""Between two looks whether the arc has come."""
OFFER_S_MAX = 20.0
"""For a promised piece to be on its way; then the neighbours are asked again."""
AGAIN_S_MIN, AGAIN_S_MAX = 1.0, 30.0
"""Pauses between two rounds of asking, each twice the one before."""

_log = logging.getLogger("scenefold.peer.joining")


class HasArcs(Protocol):
    """Routing."""

    def arc_of(self, node: NodeId) -> Arc | None: ...


class Joining:
    """`join` is given to the enrolment; `run` asks for an arc whenever this node is a member without one."""

    def __init__(
        self,
        world: World,
        line: MovesBounds,
        roster: Roster,
        routing: HasArcs,
        log: Log,
        peers: Peers,
        own: OwnStatus,
        *,
        place: Location | str = "loaded",
    ) -> None:
        """`place`: "loaded", beside the fullest node; "random"; or a location."""
        self._world = world
        self._line = line
        self._roster = roster
        self._routing = routing
        self._log = log
        self._peers = peers
        self._own = own
        self._place = place if isinstance(place, Location) else None
        self._is_random = place == "random"
        self._request: bytes | None = None
        self._said: NodeId | None = None
        self._behind_predecessor: tuple[NodeId, ...] = ()
        """Who stood right of the incarnation before this one when that was a member, the nearest first."""
        self._quiet = QuietLog(_log, logging.INFO)

    # ------------------------------------------------------------------------------------------------ registering

    async def join(self) -> None:
        """Register left of a member that is chosen now. Refused, Unreachable or PeerFault: try again."""
        await self._table_heard()
        left_of = self.choose()
        # One request for all tries: should an answer be lost, the next try learns that it was committed.
        self._request = self._request or self._world.entropy.token(16)
        if left_of != self._said:
            # It is tried each second, while the lease of an earlier incarnation lasts.
            self._said = left_of
            _log.info("joining left of %s", address_of(left_of))
        await self._log.propose(registration(self._own, left_of), self._request)

    def choose(self) -> NodeId:
        """The member to stand left of, as things are known now: where the incarnation before this one stood, if no place was asked for."""
        behind = None if self._place is not None or self._is_random else self._right_of_predecessor()
        if behind is not None:
            return behind
        if self._is_random and self._place is None:
            self._place = Location(self._world.entropy.token(LOCATION_BYTES))
        hosts = [self._host(node) for node in self._log.registry.order if node != self._own.me]
        found = None if self._place is None else owner_of(hosts, self._place)
        found = most_loaded(hosts) if found is None else found
        if found is None:
            raise Refused(RejectReason.NOT_READY, "no member of this cluster is known yet")
        return found

    def _right_of_predecessor(self) -> NodeId | None:
        registry, me = self._log.registry, self._own.me
        if registry.current(me) is not None and not registry.is_current(self._own.member):
            self._behind_predecessor = registry.order[registry.rank(me) + 1 :]
        return next(filter(registry.stands, self._behind_predecessor), None)

    def _host(self, node: NodeId) -> Host:
        status = self._roster.status(node)
        used, capacity = (0, 0) if status is None else fill_of(status)
        return Host(node, self._routing.arc_of(node), used, capacity, self._roster.is_believed_alive(node))

    def _is_heard(self) -> bool:
        """Whether all who are registered have been heard: by the log, of which the roster may hear a moment later."""
        registry = self._log.registry
        return all(
            self._roster.status(node) is not None for node in registry.order if node != self._own.me and registry.current(node) is not None
        )

    async def _table_heard(self) -> None:
        deadline = self._world.clock.now() + TABLE_S_MAX
        while not self._is_heard() and self._world.clock.now() < deadline:
            await self._world.clock.sleep(LOOK_S)

    # ---------------------------------------------------------------------------------------------------- asking

    async def run(self) -> None:
        """Ask for an arc while this node is a member without one, until cancelled."""
        pause_s = AGAIN_S_MIN
        while True:
            await self._world.clock.sleep(LOOK_S)
            if not self._is_wanting():
                pause_s = AGAIN_S_MIN
            elif await self._ask_neighbours():
                await self._arc_came()
            else:
                await self._world.clock.sleep(pause_s)
                pause_s = min(2 * pause_s, AGAIN_S_MAX)

    def _is_wanting(self) -> bool:
        registry = self._log.registry
        me = self._own.me
        # A founder takes its founding arc by itself; what is being handed to us needs no asking.
        return (
            registry.is_current(self._own.member)
            and self._line.arc is None
            and not self._line.refuses
            and not self._line.open_handovers()
            and registry.founding_arc(me) is None
        )

    async def _ask_neighbours(self) -> bool:
        """Whether one of them promised a piece. The right one first: that is whose arc we came for."""
        left, right = self._log.registry.neighbours(self._own.me)
        for node in (right, left):
            if node is not None and self._log.registry.current(node) is not None and await self._ask(node):
                return True
        return False

    async def _ask(self, node: NodeId) -> bool:
        question = AskRange(self._own.member, self._place)
        try:
            reply = await self._peers.ask(node, Priority.LOW, question, HandoverReply, ASK_S_MAX)
        except (Refused, Unreachable, PeerFault) as problem:
            self._say(node, str(problem))
            return False
        if reply.reason:
            self._say(node, reply.text)
        return not reply.reason

    async def _arc_came(self) -> None:
        deadline = self._world.clock.now() + OFFER_S_MAX
        while self._line.arc is None and self._world.clock.now() < deadline:
            await self._world.clock.sleep(LOOK_S)
            if self._line.open_handovers():
                # It is on its way: that takes as long as it takes.
                deadline = self._world.clock.now() + OFFER_S_MAX

    def _say(self, node: NodeId, text: str) -> None:
        self._quiet.say(self._world.clock.now(), address_of(node), "ask", f"no piece of the line yet: {text}")
