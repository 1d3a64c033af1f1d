"""A node hands everything over and leaves: DrainNode (74) (specs/13-balance.md, Leaving).

    serving --DrainNode--> draining: gives to both neighbours --nothing left--> RemoveNode "drained" in the log --> NodeDrained
       ^______cancel________|

The order is durable: a restarted node goes on with it. While it drains, a node takes no piece, but serves what it still
owns. It leaves only when it owns nothing, no handover is open, and no record lies here that somebody could still need.
`NodeDrained` ends this life in order; who starts the node again later starts a newcomer.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, Protocol

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.balance.emptying import Portion, next_portion
from scenefold.peer.balance.indispensable import why_never
from scenefold.peer.balance.pieces import Scales, piece_of
from scenefold.peer.balance.seams import Log, MovesBounds
from scenefold.peer.balance.takers import Takers
from scenefold.peer.cluster_log.registered import DRAINED
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.store.walking import Manifest, Rightful
from scenefold.wire import DrainNode, NodeReport, RemoveNode, pack_value
from scenefold.world import QuietLog, World

LOOK_S = 1.0
"""Between two tries, and between two looks whether the last of it has gone."""
LISTED = 16
"""Records that are looked at at once for one that is sound."""
_NOTE = "drain"
_ORDERED, _NOT_ORDERED = b"1", b""
_REFUSES = "this node is leaving, and takes nothing"

_log = logging.getLogger("scenefold.peer.draining")


async def _never() -> bool:
    return False


def _ignored(_is_closed: bool) -> None:
    """Where nobody has copies kept here."""


class NodeDrained(Exception):
    """The node has handed everything over and is no member any more. Its life ends here, in order."""


class Keeps(Scales, Protocol):
    """What is asked of the store."""

    async def strays(self, rightful: Rightful, after: bytes | None, limit: int) -> Manifest: ...
    async def put_note(self, name: str, value: bytes) -> None: ...
    async def get_note(self, name: str) -> bytes | None: ...


class Draining:
    """`register`, `load`, then `run`."""

    def __init__(
        self,
        world: World,
        store: Keeps,
        line: MovesBounds,
        roster: Roster,
        log: Log,
        own: OwnStatus,
        decides: Callable[[], Sequence[SceneId]],
        *,
        has_lease: Callable[[], bool] = lambda: True,
        may_order: Callable[[str], bool] = lambda _user: True,
        lies_elsewhere: Callable[[], Awaitable[bool]] = _never,
        close: Callable[[bool], None] = _ignored,
    ) -> None:
        """`decides`: scenes whose log this node decides. `has_lease`: whether the line lets us give anything away. `may_order`: whether a user may.

        `close`: take no copies any more, or take them again. `lies_elsewhere`: whether all that still lies here lies with all the others, who are too few for it to be taken over.
        """
        self._world = world
        self._store = store
        self._line = line
        self._log = log
        self._own = own
        self._decides = decides
        self._has_lease = has_lease
        self._may_order = may_order
        self._lies_elsewhere = lies_elsewhere
        self._close = close
        self._is_elsewhere = False
        self._ordered = trio.Event()
        self._leaving = False
        self._request: bytes | None = None
        self._begun: tuple[float, int] | None = None
        self._waits_for = ""
        self._takers = Takers(world, line, roster, log, own)
        self._quiet = QuietLog(_log, logging.INFO)

    def register(self, handlers: Handlers) -> None:
        handlers.add(DrainNode, self._on_drain, senders=Senders.USERS)

    async def load(self) -> None:
        """Go on with an order that an earlier run took."""
        if await self._store.get_note(_NOTE) == _ORDERED:
            self._begin()

    @property
    def is_leaving(self) -> bool:
        """Whether this node's removal is its own doing, so that it must not join again by itself."""
        removal = self._log.registry.removal(self._own.incarnation)
        return self._ordered.is_set() and removal is not None and removal.reason == DRAINED

    # --------------------------------------------------------------------------------------------------- the order

    async def _on_drain(self, packet: DrainNode, peer: str) -> NodeReport:
        # The wire forbids both flags at once; whatever would change something is judged here all the same.
        if (packet.cancel or not packet.check_only) and not self._may_order(peer):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no administrator of this cluster", remedy="ask one who is")
        if packet.cancel:
            await self._cancel()
        elif not packet.check_only and not self._ordered.is_set():
            problem = self._why_never()
            if problem is not None:
                raise problem
            await self._store.put_note(_NOTE, _ORDERED)
            self._begin()
            _log.info("draining: everything goes to the neighbours, then this node leaves")
        return NodeReport(pack_value(await self.report()))

    def _begin(self) -> None:
        self._ordered.set()
        self._line.refuses = _REFUSES

    async def _cancel(self) -> None:
        if self._leaving:
            what = "this node has handed everything over and is leaving"
            raise Refused(RejectReason.NOT_AUTHORISED, what, remedy="start it again once it has ended: it joins anew")
        if not self._ordered.is_set():
            # Whoever waits for the order waits for this event.
            return
        await self._store.put_note(_NOTE, _NOT_ORDERED)
        self._ordered = trio.Event()
        self._begun = None
        self._line.refuses = ""
        self._close(False)

    def _why_never(self) -> Refused | None:
        return why_never(self._own.me, self._log.registry, self._decides())

    # ----------------------------------------------------------------------------------------------------- report

    async def report(self) -> dict[str, Any]:
        """How far it is, and what stands in the way of switching the node off now."""
        statistics = await self._store.statistics()
        obstacles, never = await self._obstacles(), self._why_never()
        removal, is_member = self._log.registry.removal(self._own.incarnation), self._log.registry.is_current(self._own.member)
        has_left = removal is not None and removal.reason == DRAINED
        state = "left" if has_left else "draining" if self._ordered.is_set() else "serving"
        return {
            "state": state,
            "records": statistics.records,
            "bytes": statistics.bytes,
            "seconds_left": self._seconds_left(statistics.bytes),
            "may_switch_off": not obstacles,
            "obstacles": obstacles,
            "text": self._waits_for if self._ordered.is_set() else self._takers.why_barred() if is_member else "",
            "cannot_leave": "" if never is None else never.what,
            "room_bytes": self._takers.room_bytes() if is_member else 0,
        }

    def _seconds_left(self, left: int) -> float | None:
        if self._begun is None:
            return None
        begun_at, at_first = self._begun
        done, elapsed = at_first - left, self._world.clock.now() - begun_at
        return elapsed * left / done if done > 0 else None

    async def _obstacles(self) -> list[str]:
        """What would be lost, or be left undone, if the node were switched off now."""
        never = self._why_never()
        found = [] if never is None else [never.what]
        if self._line.arc is not None:
            totals = await self._store.arc_totals(self._line.arc)
            found.append(f"it owns a part of the line, with {totals.records} records")
        if self._line.open_handovers():
            found.append("a handover with a neighbour is under way")
        elif self._line.arc is None and await self._has_records():
            found.append("records lie here that their owners have not taken yet")
        return found

    async def _has_records(self) -> bool:
        """Sound ones: nobody would take what has rotted, but that says nothing of what lies behind it."""
        page = await self._store.strays(Rightful(()), None, LISTED)
        while page.cursor is not None and not page.entries:
            page = await self._store.strays(Rightful(()), page.cursor, LISTED)
        return bool(page.entries) and not self._is_elsewhere

    # ------------------------------------------------------------------------------------------------------ doing

    async def run(self) -> None:
        """Carry the order out once there is one. NodeDrained at the end."""
        while True:
            await self._ordered.wait()
            self._begun = self._world.clock.now(), (await self._store.statistics()).bytes
            while self._ordered.is_set():
                await (self._end() if self.is_leaving else self._step())

    async def _step(self) -> None:
        if not self._log.registry.is_current(self._own.member):
            self._waits_for = "this node is no member yet"
        elif self._line.arc is not None:
            if await self._give_some(self._line.arc):
                return
        else:
            obstacles = await self._obstacles_left()
            if not obstacles:
                # What has come since that look is found by another one, and nothing more comes.
                self._close(True)
                obstacles = await self._obstacles_left()
            self._waits_for = "; ".join(obstacles)
            if not obstacles and await self._leave():
                return
        await self._world.clock.sleep(LOOK_S)

    async def _obstacles_left(self) -> list[str]:
        self._is_elsewhere = await self._lies_elsewhere()
        return await self._obstacles()

    async def _give_some(self, arc: Arc) -> bool:
        """Give the next piece to the neighbour with more room; whether that worked."""
        if not self._has_lease():
            voters = ", ".join(map(address_of, self._log.registry.voters))
            self._wait_for(f"this node has no lease, so it can give nothing away until the voter, {voters}, answers it")
            return False
        totals = await self._store.arc_totals(arc)
        portion = next_portion(self._takers.rooms(), totals.bytes)
        if portion is None:
            self._wait_for(self._takers.why_none())
            return False
        piece = await self._piece(arc, portion)
        if not self._line.settled(piece):
            self._wait_for("what came last moves on once it has lain here for ten seconds and its giver has done with it")
            return False
        try:
            await self._line.give(portion.side, piece, why="this node is leaving")
        except (Refused, Unreachable, PeerFault) as problem:
            self._takers.refused(portion.side, str(problem))
            self._wait_for(str(problem))
            return False
        self._takers.sent(portion.side, portion.bytes)
        self._waits_for = ""
        return True

    async def _piece(self, arc: Arc, portion: Portion) -> Arc:
        if portion.is_all:
            return arc
        piece = await piece_of(self._store, arc, portion.side, portion.bytes)
        return arc if piece is None else piece.arc

    def _wait_for(self, text: str) -> None:
        self._waits_for = text
        self._quiet.say(self._world.clock.now(), "drain", text[:40], text)

    async def _leave(self) -> bool:
        """Propose the own removal; whether it is decided."""
        self._leaving = True
        self._request = self._request or self._world.entropy.token(16)
        try:
            await self._log.propose(RemoveNode(self._own.member, DRAINED), self._request)
        except (Refused, Unreachable, PeerFault) as problem:
            # An answer may be lost although it was decided: then the log says so, sooner or later.
            self._leaving = isinstance(problem, Unreachable)
            self._wait_for(str(problem))
            return False
        return True

    async def _end(self) -> None:
        try:
            await self._store.put_note(_NOTE, _NOT_ORDERED)
        except Refused as problem:
            # A full disk. With the note still there the next start would end at once, so it is tried again.
            self._wait_for(str(problem))
            await self._world.clock.sleep(LOOK_S)
            return
        _log.info("drained: everything is handed over, and this node is no member any more")
        raise NodeDrained
