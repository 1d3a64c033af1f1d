"""Each disk looked at as `scenectl node verify` looks at a folder (specs/21-verify.md): nothing may be wrong on it but what has rotted there.

A node that dies leaves what any node leaves: what follows from records (counts, trees, debts, places of objects) is as durable as they are.
"""

from __future__ import annotations

from scenefold.peer.checking.folder import check_view
from scenefold.simulation import laws
from scenefold.simulation.cluster import Cluster, Node
from scenefold.store.layout import RECORDS, TABLES, record_key
from scenefold.store.sealing import SEALED

TOLD_MAX = 3


def judge_store(cluster: Cluster, node: Node) -> None:
    """At this instant, whether the node runs or is dead."""
    if node.has_rotted or any(node.disk.rotten(table) for table in SEALED):
        # It stops over that, and gets another disk.
        return
    with node.disk.looked_at(TABLES) as view:
        found = check_view(view).listed
    rot = cluster.watch.rot
    wrong = [finding for finding in found if finding.spot is None or not rot.has(node.slot, record_key(*finding.spot))]
    for finding in wrong[:TOLD_MAX]:
        words = f"on n{node.slot}, in {finding.table}, {finding.where}: {finding.what}"
        location = finding.spot.place.location if finding.spot is not None and finding.table == RECORDS else None
        cluster.watch.violated(laws.WHOLE, words, location=location, slots=(node.slot,))


def judge_stores(cluster: Cluster) -> None:
    """Of all that have ever run."""
    for node in cluster.nodes.values():
        if node.born.is_set():
            judge_store(cluster, node)
