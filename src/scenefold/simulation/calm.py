"""After the storm: is everything as it should be? Asked once a second until it is, or until patience ends.

What is wrong is said in words, by the law that it breaks; an empty answer is quiet. Everything is read off true disks and the
tables of running nodes, nothing is asked for over the network.
"""

from __future__ import annotations

from typing import NamedTuple

from scenefold.simulation import laws
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.copies_calm import is_held, wrong_copies
from scenefold.simulation.disks import arc_of, found_at, has_open_handover, incarnation_of, keys_outside, place_of
from scenefold.simulation.history import Place
from scenefold.simulation.lineage import tiling_problems
from scenefold.store.layout import location_of


class Unrest(NamedTuple):
    """A law that does not hold yet, and how."""

    law: str
    what: str
    slots: tuple[int, ...] = ()


def unrest(cluster: Cluster) -> list[Unrest]:
    """What is not as it should be, most basic things first: what follows from them is not said yet."""
    voter = cluster.voter.context
    if voter is None:
        return [Unrest(laws.CONVERGED, "the voter does not run", (0,))]
    registry = voter.cluster_log.registry
    members = {cluster.slot_of(node) for node in registry.order}
    down = [node.slot for node in cluster.nodes.values() if node.is_wanted and node.context is None]
    wrong = [Unrest(laws.CONVERGED, f"n{slot} does not run", (slot,)) for slot in down]
    outside = [node.slot for node in cluster.nodes.values() if node.is_wanted and node.slot not in members]
    wrong += [Unrest(laws.CONVERGED, f"n{slot} is no member", (slot,)) for slot in outside]
    for slot in sorted(members):
        wrong += _member(cluster, cluster.nodes[slot])
    if missing := cluster.voters_missing():
        wrong.append(Unrest(laws.CONVERGED, missing))
    if wrong:
        return wrong
    arcs = [(f"n{slot}", arc) for slot in sorted(members) if (arc := arc_of(cluster.nodes[slot].disk)) is not None]
    wrong += [Unrest(laws.TILED, problem) for problem in tiling_problems(arcs)]
    if wrong:
        return wrong
    for node in cluster.nodes.values():
        wrong += _leftovers(cluster, node, members)
    wrong = wrong or _tables(cluster)
    return wrong or [Unrest(laws.COPIED_AGAIN, *what) for what in wrong_copies(cluster, members)]


def _member(cluster: Cluster, node: Node) -> list[Unrest]:
    """A member runs under the incarnation that is registered, knows the whole log, and holds a lease."""
    context, here = node.context, (node.slot,)
    if context is None:
        return [Unrest(laws.CONVERGED, f"n{node.slot} is a member and does not run", here)]
    voter = cluster.voter.context
    assert voter is not None
    registered = voter.cluster_log.registry.current(node.node_id)
    if registered is None or registered.incarnation != incarnation_of(node.disk):
        return [Unrest(laws.CONVERGED, f"n{node.slot} runs under another incarnation than is registered", here)]
    if context.cluster_log.registry.position != voter.cluster_log.registry.position:
        return [Unrest(laws.CONVERGED, f"n{node.slot} does not know the newest log", here)]
    if not context.lease.holds():
        return [Unrest(laws.CONVERGED, f"n{node.slot} holds no lease", here)]
    return []


def _leftovers(cluster: Cluster, node: Node, members: set[int]) -> list[Unrest]:
    if not node.born.is_set():
        return []
    if node.has_left and cluster.watch.put_back.get(node.slot) == incarnation_of(node.disk):
        # It had handed everything over when its disk was put back to an earlier state, and learns only that it has left.
        return []
    wrong = []
    arc = arc_of(node.disk) if node.slot in members else None
    if has_open_handover(node.disk):
        wrong.append(Unrest(laws.CONVERGED, f"a handover of n{node.slot} is open", (node.slot,)))
    # A rotten record cannot be offered to anybody; it lies where it rotted.
    outside = keys_outside(node.disk, arc)
    strays = [key for key in outside if not (cluster.watch.rot.has(node.slot, key) or is_held(cluster, node.disk, key, members))]
    if node.has_left:
        # What came between its last look and its removal nobody counts on, if it was refused.
        strays = [key for key in strays if not _lies_at_its_owner(cluster, node, place_of(key))]
    if strays:
        where = location_of(strays[0]).hex()[:8]
        wrong.append(Unrest(laws.CONVERGED, f"{len(strays)} strays lie on n{node.slot}, the first at {where}…", (node.slot,)))
    return wrong


def _lies_at_its_owner(cluster: Cluster, node: Node, place: Place) -> bool:
    """Of a space with copies: in that version, or a newer one."""
    version = found_at(node.disk, place)
    owners = (other for other in cluster.nodes.values() if (arc := arc_of(other.disk)) is not None and place.home in arc)
    held = next((found_at(owner.disk, place) for owner in owners), None)
    return cluster.watch.keeping.has(place) and version is not None and held is not None and held.order >= version.order


def _tables(cluster: Cluster) -> list[Unrest]:
    """Every running member routes every location to its durable owner."""
    wrong = []
    true = sorted((arc, node.node_id) for node in cluster.nodes.values() if (arc := _arc_key(node)) is not None)
    for slot, node in sorted(cluster.running.items()):
        if node.context is None:
            continue
        table = sorted(((arc.first, arc.last), owner) for owner, arc in node.context.routing.owners)
        if table != true:
            wrong.append(Unrest(laws.CONVERGED, f"the table of n{slot} is not that of the disks", (slot,)))
    return wrong


def _arc_key(node: Node) -> tuple[bytes, bytes] | None:
    arc = arc_of(node.disk)
    return None if arc is None else (arc.first, arc.last)
