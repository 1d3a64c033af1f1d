"""How often a node may begin anew: each AddNode lengthens the cluster's log, which is never shortened (specs/15-cluster-log.md). Pure.

Nothing else that a node says of itself needs a bound of its own. An incarnation is removed once, whoever proposes that, so a log has
no more removals than registrations and founders; and nobody is ever held back from leaving.
"""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.world.buckets import Buckets

AT_ONCE = 60
"""A node whose disk is wiped at every crash waits for its lease of before each time: it can do that for a quarter of an hour. Who drains
and rejoins takes longer."""
AGAIN_S = 60.0
"""Once that is used up, one more after each of these."""


class Beginnings:
    """For the voter: the registrations that it has committed since its start, of each node."""

    def __init__(self) -> None:
        self._buckets = Buckets(AT_ONCE, 1 / AGAIN_S)

    def check(self, node: NodeId, now: float) -> None:
        """Refused (13) if this node has to wait before it may be registered anew."""
        if not self._buckets.has(str(node), now):
            text = f"{address_of(node)} has begun anew too often lately: it is let in again once every {AGAIN_S:.0f} s"
            raise Refused(RejectReason.BUSY, text)

    def count(self, node: NodeId, now: float) -> None:
        """It was registered: what is refused costs nothing, so that whoever waits may ask as often as it likes."""
        self._buckets.take(str(node), now)
