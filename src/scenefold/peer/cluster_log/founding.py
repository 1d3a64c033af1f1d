"""How the cluster's log begins: its first records, by the voter that founds it (specs/15-cluster-log.md, Learning)."""

from __future__ import annotations

import logging

from scenefold.base.errors import Refused
from scenefold.peer.cluster_log.log_voter import Voter
from scenefold.peer.timing import SYNC_S
from scenefold.wire import Found, Founder
from scenefold.world import Clock
from scenefold.world.facts import ClusterFacts

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


async def found(clock: Clock, facts: ClusterFacts, voter: Voter) -> None:
    """Begin the log unless it has begun to the end; on a full disk, as soon as there is room."""
    founders = (facts.credential(node) for node in facts.founders)
    seats = tuple(Founder(one.node_id, one.public_key.raw, one.sealing_key.raw, one.address) for one in founders if one is not None)
    while True:
        try:
            await voter.found(Found(seats, facts.voters))
            return
        except Refused as refusal:
            _log.warning("the cluster's log cannot begin: %s", refusal)
            await clock.sleep(SYNC_S)
