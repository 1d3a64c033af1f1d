"""When a render is begun anew: its organiser is lost, or another node before anything was traced (specs/31-attempts.md, Begun anew)."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from scenefold.base.errors import NoLease, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.client.together import together
from scenefold.render.pool.unattended import ALL_JOBS
from scenefold.render.reports import class_told
from scenefold.wire import JobState, JobStateReply

VAIN_MAX = 3
"""So often in a row a render is begun anew that gets no further than it was: what kills it may be the scene itself."""
BEGUN_MAX = 256
PAUSE_S = 0.5
"""Before it is begun anew; twice as long each time in vain."""
CHOOSE_S_MAX = 60.0
"""So long it is tried to find out who may render it then: who knows that may just be starting."""
CHOOSE_PAUSE_S = 1.0
ANSWER_S_MAX = 5.0


@dataclass(frozen=True, slots=True)
class Begun:
    """Why a render is begun anew. `without`: addresses of nodes that do not answer, or would make other bits; `passes`: those that need not be traced again."""

    error: ScenefoldError
    without: tuple[str, ...]
    passes: int


class Tries:
    """Of one render. Pure."""

    def __init__(self) -> None:
        self.begun = 1
        self._vain = 0
        self._passes = 0

    def may_begin_anew(self, error: ScenefoldError, passes: int) -> bool:
        """Whether to, after an error. `passes`: those that need not be traced again."""
        if passes > self._passes:
            self._passes, self._vain = passes, 0
        if not self._may_pass(error) or self._vain >= VAIN_MAX or self.begun >= BEGUN_MAX:
            return False
        self.begun += 1
        self._vain += 1
        return True

    def _may_pass(self, error: ScenefoldError) -> bool:
        """After a while in which no participant answered, as when the power of all failed, it takes a while more until they lend again."""
        return may_pass(error) or (isinstance(error, NoLease) and (error.was_held or self.begun > 1))

    @property
    def pause_s(self) -> float:
        """How long to wait before."""
        return PAUSE_S * 2.0 ** (self._vain - 1)


def may_pass(error: ScenefoldError) -> bool:
    """Whether an error is of somebody who does not answer, or is not ready."""
    return isinstance(error, Unreachable) or (isinstance(error, Refused) and error.reason is RejectReason.NOT_READY)


class Heard(NamedTuple):
    """What nodes say to who asks whether they are there."""

    silent: frozenset[NodeId]
    """Those that cannot be reached just now."""
    classes: Mapping[NodeId, str]
    """The numeric class in which a node renders, of those that have loaded a renderer since they started."""


async def heard_of(cluster: Cluster, nodes: Collection[NodeId]) -> Heard:
    """Ask each of these nodes."""
    silent, classes = set[NodeId](), dict[NodeId, str]()

    async def look(node: NodeId) -> None:
        try:
            reply = await cluster.calls.ask(address_of(node), JobState(job=ALL_JOBS), JobStateReply, timeout_s=ANSWER_S_MAX)
            classes[node] = class_told(reply.document, address_of(node))
        except Unreachable:
            silent.add(node)
        except (Refused, PeerFault):
            # Whatever it is, it answers.
            return

    await together(partial(look, node) for node in nodes)
    return Heard(frozenset(silent), classes)
