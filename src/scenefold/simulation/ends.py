"""What a life of a node may end with, when nobody ended it (specs/17-simulation.md, Laws)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from scenefold.base.errors import LocalFault, Unreachable
from scenefold.peer.balance.draining import NodeDrained
from scenefold.peer.enrolment.enrolment import IdentityRenewed
from scenefold.simulation import laws
from scenefold.simulation.watch import Watch
from scenefold.store import StoreDamaged
from scenefold.world.ports import DiskFull


class Rotten(Protocol):
    """The machine of a run, as far as its ends are concerned."""

    @property
    def slot(self) -> int: ...
    @property
    def has_rotted(self) -> bool: ...

    must_be_wiped: bool


def words_of(ends: Sequence[BaseException]) -> str:
    """What a life ended with, for people."""
    return "; ".join(f"{type(end).__name__}: {end}" for end in ends) or "without a reason"


def judge_end(node: Rotten, watch: Watch, ends: Sequence[BaseException], *, came_up: bool) -> bool:
    """Whether the node has left the cluster by that; what must not be is a violation."""
    # The start must be counted durably, so none is possible on a full disk; a node that runs goes on running.
    is_full = not came_up and all(isinstance(end, LocalFault) and isinstance(end.__cause__, DiskFull) for end in ends)
    node.must_be_wiped = node.has_rotted and any(isinstance(end, StoreDamaged) for end in ends)
    is_right = is_full or node.must_be_wiped or all(isinstance(end, IdentityRenewed | NodeDrained | Unreachable) for end in ends)
    if not ends or not is_right:
        watch.violated(laws.SOUND, f"n{node.slot} ends by itself: {words_of(ends)}", slots=(node.slot,))
    if node.must_be_wiped:
        watch.counts["damage noticed"] += 1
    if any(isinstance(end, IdentityRenewed) for end in ends):
        watch.counts["new incarnations"] += 1
    if any(isinstance(end, NodeDrained) for end in ends):
        watch.counts["drained"] += 1
        return True
    return False
