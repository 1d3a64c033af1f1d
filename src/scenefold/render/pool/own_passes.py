"""The passes that a node owns: opening them, watching their ledgers, closing them into the node's film."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Sequence
from functools import lru_cache

import numpy as np

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import Location, even_right_bounds
from scenefold.base.reasons import RejectReason
from scenefold.render.arrays import U16
from scenefold.render.ledger import PassLedger
from scenefold.render.passes import PassPlan

PASSES_IN_FLIGHT = 2
"""Of each node's own passes: one closes while the next keeps everybody busy."""
PASSES_IN_FLIGHT_OF_MANY = 1
"""The same from NODES_MANY nodes on: every node keeps sums of every open pass, 4 MB a pass and thread, 8 MB with all layers."""
NODES_MANY = 16
KNOWN_PLANS = 32
"""Whose owners are remembered: of more jobs, with all of their attempts of late, than a node has places for; two bytes a pass."""
_COPY = -1
"""No node's place."""


def rays_of_a_path(depth: int) -> int:
    """That wait, at most, of a job's depth: what goes on, and of each surface that it has left a ray that looks for a light."""
    return depth


def passes_in_flight(nodes: int) -> int:
    """Of each node's own passes, among so many nodes."""
    return PASSES_IN_FLIGHT if nodes < NODES_MANY else PASSES_IN_FLIGHT_OF_MANY


def pass_owner(plan: PassPlan, number: int, nodes: int) -> int:
    """The index of the node whose even arc of the line holds the pass's location."""
    return owner_index(plan.location(number), nodes)


@lru_cache(maxsize=KNOWN_PLANS)
def owners_of(plan: PassPlan, nodes: int) -> U16:
    """The same of all passes, u16[count], read only. It takes microseconds a pass: whoever needs it in time has it made in a worker before."""
    owners = np.fromiter((pass_owner(plan, number, nodes) for number in range(plan.count)), np.uint16, plan.count)
    owners.setflags(write=False)
    return owners


def owner_index(location: Location, nodes: int) -> int:
    """Which of `nodes` even arcs holds a location."""
    return bisect_left(_right_bounds(nodes), location)


@lru_cache(maxsize=8)
def _right_bounds(nodes: int) -> list[Location]:
    return even_right_bounds(nodes)


def closed_pass(plan: PassPlan, nodes: int, node: int, number: int) -> int:
    """The pass that the job's node of an index says is closed; PeerFault if there is none, Refused (12) if it is another node's."""
    if number >= plan.count:
        raise PeerFault("the job has no such pass", where=f"pass {number}")
    if pass_owner(plan, number, nodes) != node:
        raise Refused(RejectReason.NOT_AUTHORISED, "a pass is closed by another node", where=f"pass {number}, node {node} of the job")
    return number


class OwnPasses:
    """One node's passes of a job, in order. Pure."""

    def __init__(self, plan: PassPlan, nodes: Sequence[NodeId], me: int, done: Collection[int] = frozenset()) -> None:
        """`done`: passes that are closed already."""
        mine = np.flatnonzero(owners_of(plan, len(nodes)) == me).tolist()
        self._waiting = [number for number in mine if number not in done]
        self._waiting.reverse()
        self._nodes = len(nodes)
        self._open_max = passes_in_flight(len(nodes))
        self._until = 0
        self.total = len(self._waiting)
        self.closed = 0
        """And copied."""
        self.opened = 0
        self.ledgers: dict[int, PassLedger] = {}
        self._untold: dict[int, set[int]] = {}
        """Closed passes, and the nodes that may still keep sums of them; `_COPY` while there is no copy."""

    def may_open(self) -> bool:
        """Whether a pass waits and few enough are open, or still kept by others since they do not know that these are closed."""
        few = len(self.ledgers) < self._open_max and len(self.ledgers) + len(self._untold) < 2 * self._open_max
        return bool(self._waiting) and self._waiting[-1] < self._until and few

    def skip(self, first: int) -> None:
        """Passes below this number were closed by others before."""
        while self._waiting and self._waiting[-1] < first:
            self._waiting.pop()

    def release(self, until: int) -> None:
        """Passes below this number may be opened."""
        self._until = max(self._until, until)

    def open_next(self) -> int:
        """Open the next pass; its number."""
        number = self._waiting.pop()
        self.opened += 1
        self.ledgers[number] = PassLedger(self._nodes)
        return number

    def close(self, number: int, untold: Collection[int] = (), *, is_copied: bool = True) -> None:
        """A pass's sums are in the film. These nodes have sums of it until they are told; and one is to keep a copy, unless `is_copied`."""
        del self.ledgers[number]
        self.closed += is_copied
        waiting = {*untold} if is_copied else {*untold, _COPY}
        if waiting:
            self._untold[number] = waiting

    def copied(self, number: int) -> None:
        """Its keeper has a closed pass."""
        self.closed += 1
        self.told(number, _COPY)

    def told(self, number: int, node: int) -> None:
        """One more node knows that a pass is closed."""
        waiting = self._untold.get(number)
        if waiting is not None:
            waiting.discard(node)
            if not waiting:
                del self._untold[number]
