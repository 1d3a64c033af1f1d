"""A voter that is away for T_EVICT_S is removed as one by another, so that fewer must be there from then on (specs/26-modes.md, Voters come
and go). It stays a member, as long as it would otherwise."""

from __future__ import annotations

import logging

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.waking import Waking
from scenefold.peer.timing import T_EVICT_S
from scenefold.wire import RemoveParticipant
from scenefold.world import Clock

LOOK_S = 10.0
"""Between two looks; each voter waits for as long again behind the one before it, so that one of them proposes."""
VOTERS_MIN = 3
"""Of two none can be removed without the other."""

_log = logging.getLogger("scenefold.peer.membership.probing")


class Evicting:
    """Used from the Trio thread only."""

    def __init__(self, clock: Clock, cluster_log: ClusterLog, roster: Roster, me: NodeId) -> None:
        self._clock, self._cluster_log, self._roster, self._me = clock, cluster_log, roster, me
        self._started_at = clock.now()
        self._waking = Waking(clock)

    async def run(self) -> None:
        """Look until cancelled."""
        while True:
            await self._clock.sleep(LOOK_S)
            self._waking.since()
            for node in self.away():
                await self._evict(node)

    def away(self) -> list[NodeId]:
        """Voters that have been silent for too long, if this one grants leases and hears enough of the others to say so."""
        log, now = self._cluster_log, self._clock.now()
        voters = log.registry.voting.deciders
        if voters is None or not log.voting.is_ready or len(voters.everyone) < VOTERS_MIN:
            return []
        others = sorted(voters.nodes - {self._me})
        silent_s = {node: now - self._heard_at(node) for node in others}
        if 1 + sum(seconds < T_EVICT_S / 2 for seconds in silent_s.values()) < voters.majority:
            return []
        rank = sum(node < self._me for node in others)
        return [node for node in others if silent_s[node] > T_EVICT_S + rank * LOOK_S]

    def _heard_at(self, node: NodeId) -> float:
        begun = max(
            self._started_at, self._waking.since(), self._cluster_log.learnt_at(self._cluster_log.registry.voting.councils[-1].position)
        )
        known = (self._roster.proof_at(node), self._cluster_log.leased_at(node))
        return max(begun, *(at for at in known if at is not None), begun)

    async def _evict(self, node: NodeId) -> None:
        voters = self._cluster_log.registry.voting.deciders
        member = None if voters is None else voters.member_of(node)
        if member is None:
            return
        _log.warning("the voter %s has been away for %.0f min: it shall vote no more", address_of(node), T_EVICT_S / 60)
        try:
            await self._cluster_log.propose(RemoveParticipant(member))
        except (Refused, Unreachable, PeerFault) as problem:
            _log.info("the voter %s was not removed: %s", address_of(node), problem)
