"""Who of a leaving node's neighbours can take something now, how much, and why not (specs/13-balance.md, Leaving)."""

from __future__ import annotations

from scenefold.base.ids import NodeId, address_of
from scenefold.peer.balance.barred import Barred
from scenefold.peer.balance.emptying import room_of
from scenefold.peer.balance.seams import HasRegistry, MovesBounds, fill_of
from scenefold.peer.line.ends import Side
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.world import World

REFUSED_S = 5.0
"""A neighbour that refused is left alone for so long; meanwhile the other one gets its turn."""


class Takers:
    """The neighbours of one node, by their statuses and by what was sent to them since."""

    def __init__(self, world: World, line: MovesBounds, roster: Roster, log: HasRegistry, own: OwnStatus) -> None:
        self._world = world
        self._line = line
        self._roster = roster
        self._log = log
        self._own = own
        self._barred = Barred(roster, log, own)
        self._refused: dict[Side, tuple[float, str]] = {}
        """Until when a neighbour is left alone, and what it said."""
        self._sent_since: dict[NodeId, tuple[int, int]] = {}

    def rooms(self) -> dict[Side, int]:
        """The bytes that each neighbour has room for, of those that can take something now."""
        return {side: room for side in Side if (room := self._room(side)) is not None}

    def room_bytes(self) -> int:
        """What those that are heard have room for together, whether or not they could take something at this moment."""
        beside = [node for side in Side if (node := self._neighbour(side)) is not None]
        nodes = [node for node in beside if self._roster.is_believed_alive(node) and not self._is_barred(node)]
        statuses = [status for node in nodes if (status := self._roster.status(node)) is not None]
        return sum(max(0, room_of(*fill_of(status))) for status in statuses)

    def why_none(self) -> str:
        """Why no neighbour takes anything, for people."""
        found = []
        for side in Side:
            node = self._neighbour(side)
            if node is not None:
                found.append(self._why_unasked(side, node) or f"{address_of(node)} has no room for what lies here")
        return "; ".join(found) or "there is no neighbour that could take what lies here"

    def why_barred(self) -> str:
        """Which neighbours would never take anything as things are, for people; empty if all would."""
        nodes = [self._neighbour(side) for side in Side]
        return "; ".join(_why_barred(node) for node in nodes if node is not None and self._is_barred(node))

    def refused(self, side: Side, text: str) -> None:
        """The neighbour on that side has refused a piece, or fell silent."""
        self._refused[side] = self._world.clock.now() + REFUSED_S, text

    def sent(self, side: Side, size: int) -> None:
        """So much went to that side, and may not be in its status yet."""
        node = self._neighbour(side)
        status = None if node is None else self._roster.status(node)
        if node is not None and status is not None:
            lamport, sent = self._sent_since.get(node, (status.lamport, 0))
            self._sent_since[node] = status.lamport, size + (sent if lamport == status.lamport else 0)

    def _room(self, side: Side) -> int | None:
        node = self._neighbour(side)
        status = None if node is None else self._roster.status(node)
        if node is None or status is None or self._why_unasked(side, node):
            return None
        # What went there since its last status is not in that.
        lamport, sent = self._sent_since.get(node, (status.lamport, 0))
        return room_of(*fill_of(status)) - (sent if lamport == status.lamport else 0)

    def _why_unasked(self, side: Side, node: NodeId) -> str:
        """Why the neighbour on that side can take nothing at this moment, whatever room it has; empty if it can."""
        if self._line.busy(side):
            return f"a handover with {address_of(node)} is under way"
        status = self._roster.status(node)
        if status is None or not self._roster.is_believed_alive(node) or self._log.registry.current(node) is None:
            return f"{address_of(node)} does not answer"
        if fill_of(status)[1] == 0:
            return f"{address_of(node)} still finds out what lies in its part of the line"
        if self._is_barred(node):
            return _why_barred(node)
        until, text = self._refused.get(side, (0.0, ""))
        return text if self._world.clock.now() < until else ""

    def _is_barred(self, node: NodeId) -> bool:
        """Whether it could write nothing of this node's, once that is gone; no matter if this one cannot either."""
        return node in self._barred.now(without=self._own.me) and self._own.me not in self._barred.now()

    def _neighbour(self, side: Side) -> NodeId | None:
        left, right = self._log.registry.neighbours(self._own.me)
        return left if side is Side.LEFT else right


def _why_barred(node: NodeId) -> str:
    at = address_of(node)
    return f"the blacklist of {at} allows no other node to hold copies: take something off it (`scenectl node blacklist rm`)"
