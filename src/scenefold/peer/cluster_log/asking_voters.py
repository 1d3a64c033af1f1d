"""A node has something decided: it asks those who decide the cluster's log, one after the other, until one says what became of it
(specs/15-cluster-log.md, Proposing; Voters)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass

import trio

from scenefold.base.errors import NotReached, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.log_packets import proposal_of
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.peers import Peers
from scenefold.peer.timing import PROPOSE_ASK_S_MAX, PROPOSE_RETRY_S, PROPOSE_S_MAX
from scenefold.wire import AcceptSceneProposal, LogEntry, LogRecord, Packet, RejectSceneProposal
from scenefold.world import Priority, World
from scenefold.world.facts import ClusterFacts

Decide = Callable[[LogEntry, bytes, NodeId], Awaitable[int]]

ELSEWHERE = frozenset(
    {
        RejectReason.NOT_MY_LOCATION,
        RejectReason.NOT_READY,
        RejectReason.NO_MAJORITY,
        RejectReason.PEER_MISSED,
        RejectReason.BUSY,
        RejectReason.STORAGE_FULL,
    }
)
"""Why one voter has not had something decided, where another one may."""


@dataclass(slots=True)
class _Doubt:
    """Of one proposal, over all its rounds: whether a voter that was asked may have put it to the vote. No later refusal of another kind ends that."""

    is_open: bool = False


class AskingVoters:
    """Used from the Trio thread only. `decide`: where this node is a voter itself. `learn` pulls the log from a node, up to a position."""

    def __init__(
        self,
        world: World,
        peers: Peers,
        facts: ClusterFacts,
        me: NodeId,
        registry: Callable[[], Registry],
        decide: Decide,
        learn: Callable[[NodeId, int], Awaitable[Registry]],
    ) -> None:
        self._world, self._peers, self._facts, self._me = world, peers, facts, me
        self._registry, self._decide, self._learn = registry, decide, learn

    async def propose(self, entry: LogEntry, request: bytes) -> int:
        """As ClusterLog.propose."""
        last: Unreachable | None = None
        doubt = _Doubt()
        with trio.move_on_after(PROPOSE_S_MAX):
            while True:
                try:
                    return await self._round(entry, request, doubt)
                except Unreachable as problem:
                    last = problem
                await self._world.clock.sleep(PROPOSE_RETRY_S)
        voters = ", ".join(map(address_of, self._order()))
        raise last or Unreachable("nobody who decides the cluster's log has answered in time", where=voters)

    def _order(self) -> Sequence[NodeId]:
        """This node if it votes, those that seem alive, the others."""
        if not self._registry().voting.councils:
            return (self._facts.voter,)
        voters = self._registry().voters
        first = [self._me] if self._me in voters else []
        return [*first, *(node for node in self._peers.others() if node in voters)]

    async def _round(self, entry: LogEntry, request: bytes, doubt: _Doubt) -> int:
        """Ask each once. Refused: none of those who were asked, now or before, has put it to the vote, or it can be none any more. Unreachable: who knows."""
        last = Unreachable("no voter is known that could be asked")
        refusal: Refused | None = None
        for voter in self._order():
            try:
                return await self._ask(voter, entry, request)
            except Refused as refused:
                if not self._registry().voting.councils:
                    # Who decides alone knows what it has decided.
                    raise
                if refused.reason in ELSEWHERE:
                    # What it may have begun, it does not call refused.
                    doubt.is_open = doubt.is_open or refused.reason is RejectReason.NOT_READY
                    refusal = refused
                    continue
                if doubt.is_open:
                    self._check_other(entry, request)
                    raise Unreachable(f"one voter refuses it, and another one may have it decided: {refused.what}") from refused
                raise
            except Unreachable as problem:
                doubt.is_open, last = doubt.is_open or not isinstance(problem, NotReached), problem
        if refusal is not None and not doubt.is_open:
            raise refusal
        raise last if refusal is None else Unreachable(refusal.what, where=refusal.where) from refusal

    def _check_other(self, entry: LogEntry, request: bytes) -> None:
        """Refused if the log holds something else under this request's id: then it never will be."""
        self._registry().committed_at(request, entry)

    async def _ask(self, voter: NodeId, entry: LogEntry, request: bytes) -> int:
        if voter == self._me:
            return await self._decide(entry, request, self._me)
        registry = self._registry()
        packet = proposal_of(LogRecord(registry.position + 1, registry.head, request, self._me, entry), self._facts)
        reply = await self._peers.ask(voter, Priority.HIGH, packet, Packet, PROPOSE_ASK_S_MAX)
        if isinstance(reply, RejectSceneProposal):
            words = reply.reason.name.lower().replace("_", " ")
            raise Refused(reply.reason, f"the cluster's log refuses a {type(entry).__name__}: {words}", where=address_of(reply.node))
        if not isinstance(reply, AcceptSceneProposal):
            raise PeerFault(f"a proposal was answered with a {type(reply).__name__}", where=address_of(voter))
        return (await self._learn(voter, reply.position)).position_of(request) or reply.position


async def ask_in_turn(nodes: Sequence[NodeId], ask: Callable[[NodeId], Awaitable[Packet]]) -> Packet:
    """The answer of the first that can have something decided; the error of the last if none can. What is asked counts once, however often.

    Refused: none of them has put it to the vote. Unreachable: one may have, whatever the others say.
    """
    last: ScenefoldError = Unreachable("no voter is known that could be asked")
    doubt: Unreachable | None = None
    for node in nodes:
        try:
            return await ask(node)
        except Unreachable as problem:
            last = problem
            if not isinstance(problem, NotReached):
                doubt = problem
        except Refused as refusal:
            if refusal.reason is RejectReason.NOT_READY:
                # What it may have begun, it does not call refused.
                doubt = doubt or Unreachable(refusal.what, where=refusal.where, remedy=refusal.remedy)
            if refusal.reason not in ELSEWHERE:
                if doubt is not None:
                    raise doubt from refusal
                raise
            last = refusal
    raise doubt or last
