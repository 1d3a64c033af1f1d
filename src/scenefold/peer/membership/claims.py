"""May this status be believed? (thesis C.1; specs/11-peers.md, Gossip.) Pure; many at once run in the crypto lane.

A status speaks for the node that it describes, whoever passes it on, so it is judged by that node's key. What a node
claims to own cannot be proven by gossip; but what is ours, we know. A claim on it by somebody who knows no more of the
cluster's log than we do is old news, or wrong. One who says that he knows more may be right, since we may have been removed:
so nothing of what he claims counts before we know as much ourselves, and if nobody can show us that log, it never does.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import Arc
from scenefold.crypto import STATUS_DOMAIN, PublicKey
from scenefold.peer.membership.status import arc_of_status
from scenefold.wire import Status


def problem_of(status: Status, key: PublicKey | None) -> str:
    """Why a status must not count, whatever we know; empty if it may. `key`: of the node that it describes, if known."""
    if key is None:
        return "nobody knows its key"
    try:
        key.verify(status.signature, STATUS_DOMAIN, status.signable())
    except DamagedData as error:
        return str(error)
    if status.address != address_of(status.node):
        return f"it claims the address {status.address}"
    if status.lamport >> 32 != status.boot:
        return "its Lamport time is of another boot than it says"
    return ""


def problems_of(statuses: Sequence[tuple[Status, PublicKey | None]]) -> list[str]:
    """The same for many."""
    return [problem_of(status, key) for status, key in statuses]


def is_early(status: Status, log_position: int) -> bool:
    """Whether a status speaks of a cluster's log that is not known here yet, so that its claims cannot be judged."""
    return status.log_position > log_position


def claims_what_is_ours(status: Status, own_arc: Arc | None) -> bool:
    """Whether a status contradicts what this node durably owns."""
    claimed = arc_of_status(status)
    return own_arc is not None and claimed is not None and claimed.intersection(own_arc) is not None


class LastingClaims:
    """Since when which nodes claim what is ours, without a longer break. Those that cannot be judged yet (early) are apart."""

    def __init__(self) -> None:
        self._times: dict[tuple[NodeId, bool], tuple[float, float]] = {}
        """The first and the last of those that are going on."""

    def note(self, node: NodeId, early: bool, now: float, break_s_max: float) -> float:
        """A claim; for how long there have been such by now."""
        first, last = self._times.get((node, early), (now, now))
        first = now if now - last > break_s_max else first
        self._times[node, early] = first, now
        return now - first

    def end(self, node: NodeId) -> None:
        """It says itself that it claims nothing of ours."""
        for early in (False, True):
            self._times.pop((node, early), None)
