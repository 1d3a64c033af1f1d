"""Looks at every removal in the cluster's log and judges whether it was right (reach.py says who could be heard)."""

from __future__ import annotations

import trio

from scenefold.peer.cluster_log.registered import DRAINED, NO_INCARNATION, Removal
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.timing import REMOVE_AFTER_S as DEFAULT_REMOVE_AFTER_S
from scenefold.simulation import laws
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.disks import incarnation_of
from scenefold.simulation.lineage import Holder

LOOK_S = 0.25
JUDGED_S = 20.0
"""A removal is written, and seen here, so long after the voter had nothing against it: its disk may be slow."""


async def watch_removals(cluster: Cluster) -> None:
    """Look at the voter's log until cancelled."""
    position = 0
    while True:
        context = cluster.voter.context
        if context is not None and cluster.watch.keeping.rules:
            cluster.watch.keeping.registered(_members(cluster, context.cluster_log.registry))
        if context is not None and context.cluster_log.registry.position > position:
            registry = context.cluster_log.registry
            for removal in registry.removed.values():
                if removal.position > position:
                    _removed(cluster, removal)
            position = registry.position
        await trio.sleep(LOOK_S)


def _members(cluster: Cluster, registry: Registry) -> frozenset[Holder]:
    registered = [known for node in registry.order if (known := registry.current(node)) is not None]
    return frozenset(Holder(cluster.slot_of(known.node), known.incarnation) for known in registered)


def _removed(cluster: Cluster, removal: Removal) -> None:
    slot, watch, now = cluster.slot_of(removal.member.node), cluster.watch, cluster.net.now
    watch.tell(slot, "is removed ({}): {}", removal.member.incarnation.hex()[:8], removal.reason)
    watch.counts["removals"] += 1
    watch.removed(slot, removal.member.incarnation)
    node = cluster.nodes[slot]
    if removal.reason == DRAINED and node.told_to_leave:
        return
    if removal.member.incarnation == NO_INCARNATION or incarnation_of(node.disk) != removal.member.incarnation:
        return
    judged_at = watch.judged_at.get(removal.member.incarnation, now)
    if now - judged_at > JUDGED_S:
        judged_at = now
    window = (judged_at - (cluster.habits.remove_after_s or DEFAULT_REMOVE_AFTER_S) / 2, judged_at)
    context = cluster.voter.context
    voters = [0] if context is None else [cluster.slot_of(voter) for voter in context.cluster_log.registry.voters]
    if node.is_wanted and all(watch.reach.was_reachable(slot, voter, list(cluster.running), window) for voter in voters):
        watch.violated(laws.REMOVED_RIGHTLY, f"n{slot} is removed though it could be reached: {removal.reason}", slots=(slot, *voters))
