"""After the storm: does each record lie where the rules say, and nowhere else? (specs/17-simulation.md, Laws: as many copies again)

Read off true disks. Where copies belong is computed here anew from arcs and racks, and not asked of nodes.
"""

from __future__ import annotations

from collections.abc import Iterator

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.copying import holders
from scenefold.simulation.disks import Disk, arc_of, copies_of, place_of, records_of
from scenefold.simulation.history import Place, Version
from scenefold.store.layout import DEBTS, space_of

Arcs = dict[NodeId, Arc]
Wrong = tuple[str, tuple[int, ...]]
"""In words, and on which slots."""


def is_held(cluster: Cluster, disk: Disk, key: bytes, members: set[int]) -> bool:
    """Whether a record lies on a disk by custody, held for its owner; or the rules allow too few copies, so nobody may drop one."""
    rule = cluster.watch.keeping.rules.get(space_of(key))
    copies = None if rule is None else copies_of(disk)
    if rule is None or copies is None:
        return False
    place = place_of(key)
    if any(entry.layout == rule.layout and place.home in entry.arc for entry in copies.custody.entries):
        return True
    line = _line([cluster.nodes[slot] for slot in sorted(members)])
    return len(_wanted(cluster, line, place)) < cluster.watch.keeping.needed(place)


def wrong_copies(cluster: Cluster, members: set[int]) -> Iterator[Wrong]:
    """Everything that is not as it should be; the members' arcs tile the line."""
    if not cluster.watch.keeping.rules:
        return
    nodes = [cluster.nodes[slot] for slot in sorted(members)]
    open_ends = [wrong for node in nodes for wrong in _unsettled(node)]
    # As long as holders change, copies are where they were.
    yield from open_ends or _misplaced(cluster, nodes)


def _unsettled(node: Node) -> Iterator[Wrong]:
    owed = len(node.disk.peek(DEBTS))
    if owed:
        yield f"n{node.slot} still owes copies of {owed} records", (node.slot,)
    copies = copies_of(node.disk)
    if copies is None:
        return
    if copies.unrecovered:
        yield f"n{node.slot} still recovers {_span(copies.unrecovered[0])}", (node.slot,)
    me = copies.configurations.me
    for segment in copies.configurations.segments:
        if not segment.is_idle(me):
            untold = ", ".join(str(member.node) for member in segment.untold(me))
            state = "changes" if segment.change is not None else f"has not told {untold}" if untold else "has no configuration of its own"
            yield f"n{node.slot} {state} in {_span(segment.arc)}", (node.slot,)
            return


def _misplaced(cluster: Cluster, nodes: list[Node]) -> Iterator[Wrong]:
    keeping, rot = cluster.watch.keeping, cluster.watch.rot
    line = _line(nodes)
    found: dict[Place, dict[int, Version]] = {}
    for node in nodes:
        for place, version in records_of(node.disk).items():
            if keeping.has(place):
                found.setdefault(place, {})[node.slot] = version
    for place, versions in sorted(found.items()):
        wanted = _wanted(cluster, line, place)
        best = max(versions.values(), key=lambda version: version.order)
        # A copy that has rotted is not known to have before it is read.
        lacking = [other for other in sorted(wanted) if versions.get(other) != best and not rot.is_at(other, place)]
        beside = sorted(versions.keys() - set(wanted)) if len(wanted) >= keeping.needed(place) else []
        if lacking or beside:
            name = f"{best.digest.hex()[:6]} of {place.location.hex()[:8]}… in space {place.space}, which n{wanted[0]} owns"
            words = [f"is not on {', '.join(f'n{other}' for other in lacking)}"] if lacking else []
            words += [f"is on {', '.join(f'n{other}' for other in beside)} for no reason"] if beside else []
            yield f"{name}, {', and '.join(words)}", tuple(sorted({wanted[0], *lacking, *beside}))
            return


def _line(nodes: list[Node]) -> Arcs:
    """The members' true arcs."""
    return {node.node_id: arc for node in nodes if (arc := arc_of(node.disk)) is not None}


def _wanted(cluster: Cluster, line: Arcs, place: Place) -> list[int]:
    """The slots on whose disks a record is to lie, its owner's first; nobody's if the arcs do not tile the line."""
    owner = next((node for node in line if place.home in line[node]), None)
    if owner is None:
        return []
    slot, copying = cluster.slot_of(owner), cluster.habits.copying
    forbidden = () if copying is None else copying.forbidden_to(slot)
    rule = cluster.watch.keeping.rules[place.scene, place.space]
    return [slot, *map(cluster.slot_of, holders(rule, place.home, owner, line, forbidden))]


def _span(arc: Arc) -> str:
    return f"{arc.first.hex()[:8]}… to {arc.last.hex()[:8]}…"
