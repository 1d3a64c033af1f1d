"""What a node believes of all others' fill, and how far that may be wrong (specs/13-balance.md, Doubt). Pure.

Statuses of different nodes are of different age. If A gave B ten and we have heard of B since, but not of A, we see ten
too many: whoever acts on that gives too much, and takes it back later. What is stored does not change by moving, so such
an error can be seen: everything that was heard before the oldest news of all is whole; what has changed since then, added up
over one side of a bound, may be half of a story. That sum is the *doubt* of the side. Changes that belong together
cancel in it as soon as both have been heard. All of it is gone once everybody has been heard again, or after the time in
which everybody whose fill had changed has said so.

What passed between us and a neighbour is known at both ends at once, so it is booked on both, past and present.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.peer.balance.policy import NodeFill

NEWS_KEPT_MAX = 64
"""Changes remembered of one node; beyond it the oldest is taken for whole."""


@dataclass(slots=True)
class _Known:
    capacity: int
    used: int
    lamport: int
    incarnation: bytes
    heard_at: float
    before: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=NEWS_KEPT_MAX))
    """(until when we believed it, used), oldest first."""

    def as_of(self, moment: float) -> int:
        """What we believed at a moment; the oldest that we remember if that is longer ago."""
        return next((used for until, used in self.before if until > moment), self.used)


class News:
    """The newest known fill of each node, with what was believed before. Of this node itself it is measured."""

    def __init__(self, me: NodeId, relay_s: float) -> None:
        """`relay_s`: how old a status may be, usually, when it is heard."""
        self._me = me
        self._relay_s = relay_s
        self._known: dict[NodeId, _Known] = {}
        self._passed = 0
        """Bytes that came to this node less those that went, booked since its last measurement."""

    def measure(self, used: int, capacity: int, now: float) -> None:
        """This node's own fill at this moment."""
        known = self._known.get(self._me)
        if known is not None and self._passed:
            for index, (until, before) in enumerate(known.before):
                known.before[index] = (until, max(0, before + self._passed))
            # What passed is in the last measurement already, or comes with this one: whichever leaves less unexplained.
            change = used - known.used
            if abs(change - self._passed) <= abs(change):
                known.used += self._passed
        self._passed = 0
        self._take(self._me, -1, b"", used, capacity, now)

    def hear(self, node: NodeId, lamport: int, used: int, capacity: int, now: float, *, incarnation: bytes = b"") -> None:
        """A status of another node; it counts if its Lamport time is above that of the last one. A new incarnation begins anew."""
        known = self._known.get(node)
        if known is None or lamport > known.lamport or incarnation != known.incarnation:
            self._take(node, lamport, incarnation, used, capacity, now)

    def _take(self, node: NodeId, lamport: int, incarnation: bytes, used: int, capacity: int, now: float) -> None:
        known = self._known.get(node)
        if known is None or incarnation != known.incarnation:
            self._known[node] = _Known(capacity, used, lamport, incarnation, now)
            return
        if used != known.used:
            known.before.append((now, known.used))
        known.capacity, known.used, known.lamport, known.heard_at = capacity, used, lamport, now

    def book(self, source: NodeId, target: NodeId, size: int) -> None:
        """So many bytes passed between this node and a neighbour: what was believed of both before is as if it had then.

        This node's own fill is measured, so only its past is changed, when it is measured next.
        """
        for node, change in ((source, -size), (target, size)):
            known = self._known.get(node)
            if node == self._me:
                self._passed += change
            elif known is not None:
                known.used = max(0, known.used + change)
                for index, (until, used) in enumerate(known.before):
                    known.before[index] = (until, max(0, used + change))

    def keep_only(self, nodes: Sequence[NodeId]) -> None:
        """Forget all others."""
        kept = set(nodes)
        self._known = {node: known for node, known in self._known.items() if node in kept}

    def fill(self, node: NodeId, *, takes: bool) -> NodeFill:
        """What is believed of a node; `takes`: it is heard, and would take a piece. One never heard would not."""
        known = self._known.get(node)
        return NodeFill(0, 0, open=False) if known is None else NodeFill(known.used, known.capacity, open=takes)

    def changes(self, nodes: Sequence[NodeId], told_until: float) -> list[int]:
        """For each of these nodes: how much its news have changed since the oldest of them all; 0 for one never heard.

        `told_until`: what had changed by then, its node has told since, so nobody's news are older than that.
        """
        heard = [self._known[node].heard_at for node in nodes if node in self._known]
        whole = max(min(heard, default=0.0), told_until) - self._relay_s
        return [known.used - known.as_of(whole) if (known := self._known.get(node)) is not None else 0 for node in nodes]
