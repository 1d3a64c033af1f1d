"""After the storm: does each record lie where the rules say, and nowhere else? (specs/17-simulation.md, Laws: as many copies again)

Read off true disks. Where copies belong is computed here anew from arcs and racks, and not asked of nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.peer.copies.entries import Entry, joined
from scenefold.simulation.blacklists import blacklist_of
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.copying import holders
from scenefold.simulation.disks import Disk, arc_of, copies_of, place_of, records_of
from scenefold.simulation.history import Place, Version
from scenefold.store.layout import DEBTS, space_of
from scenefold.wire import Member

Arcs = dict[NodeId, Arc | None]
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
    line = line_of(cluster.nodes[slot] for slot in sorted(members))
    return len(wanted_slots(cluster, line, place)) < cluster.watch.keeping.needed(place)


def wrong_copies(cluster: Cluster, members: set[int]) -> Iterator[Wrong]:
    """Everything that is not as it should be; the members' arcs tile the line."""
    if not cluster.watch.keeping.rules:
        return
    nodes = [cluster.nodes[slot] for slot in sorted(members)]
    open_ends = [wrong for node in nodes for wrong in _unsettled(node)]
    # As long as holders change, copies are where they were.
    yield from open_ends or [*_untold(cluster, nodes), *_misplaced(cluster, nodes)]


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


def _untold(cluster: Cluster, nodes: list[Node]) -> Iterator[Wrong]:
    """Each holder keeps what the owners of today count on, and nothing else: by what another one has said it would still answer."""
    told: dict[Member, list[Entry]] = {}
    kept = {copies.configurations.me: (node.slot, copies) for node in nodes if (copies := copies_of(node.disk)) is not None}
    for me, (_, copies) in kept.items():
        for segment in copies.configurations.segments:
            active = segment.active(me)
            for member in () if active is None else active.members[1:]:
                if (entry := segment.wanted(member, me)) is not None:
                    told.setdefault(member, []).append(entry)
    for member, (slot, copies) in kept.items():
        entries = joined(replace(entry, fenced=False) for entry in copies.custody.entries)
        wanted = joined(told.get(member, []))
        intruded = cluster.watch.recorder.lies.intruded
        entries = tuple(entry for entry in entries if (member.node, entry.owner.node, entry.number) not in intruded)
        for entry in sorted({*entries} ^ {*wanted}, key=lambda entry: (entry.layout, entry.arc.first)):
            word = "holds for" if entry in entries else "does not hold for"
            words = f"n{slot} {word} n{cluster.slot_of(entry.owner.node)} {_span(entry.arc)} under {entry.number}"
            yield words, (slot, cluster.slot_of(entry.owner.node))
            return


def _misplaced(cluster: Cluster, nodes: list[Node]) -> Iterator[Wrong]:
    keeping, rot = cluster.watch.keeping, cluster.watch.rot
    line = line_of(nodes)
    found: dict[Place, dict[int, Version]] = {}
    for node in nodes:
        for place, version in records_of(node.disk).items():
            if keeping.has(place):
                found.setdefault(place, {})[node.slot] = version
    for place, versions in sorted(found.items()):
        wanted = wanted_slots(cluster, line, place)
        best = max(versions.values(), key=lambda version: version.order)
        before = rot.before(wanted[0], place) if wanted else None
        if all(rot.is_at(other, place) for other, version in versions.items() if version == best) or (
            before is not None and before.order > best.order
        ):
            # Of what nobody has sound there is nothing to copy; and what is older is given to nobody in its place.
            continue
        # A copy that has rotted is not known to have before it is read; and who says that it has what it has not is not asked again for an hour.
        excused = {other for other in wanted if rot.is_at(other, place) or keeping.is_liar(other, place)}
        lacking = [other for other in sorted(set(wanted) - excused) if versions.get(other) != best]
        beside = sorted(versions.keys() - set(wanted)) if len(wanted) >= keeping.needed(place) else []
        if lacking or beside:
            name = f"{best.digest.hex()[:6]} of {place.location.hex()[:8]}… in space {place.space}, which n{wanted[0]} owns"
            words = [f"is not on {', '.join(f'n{other}' for other in lacking)}"] if lacking else []
            words += [f"is on {', '.join(f'n{other}' for other in beside)} for no reason"] if beside else []
            yield f"{name}, {', and '.join(words)}", tuple(sorted({wanted[0], *lacking, *beside}))
            return


def line_of(nodes: Iterable[Node]) -> Arcs:
    """The true arcs of nodes; None of those that have none yet."""
    return {node.node_id: arc_of(node.disk) for node in nodes}


def wanted_slots(cluster: Cluster, line: Arcs, place: Place) -> list[int]:
    """The slots on whose disks a record is to lie, its owner's first; nobody's if the arcs do not tile the line."""
    arcs = {node: arc for node, arc in line.items() if arc is not None}
    owner = next((node for node, arc in arcs.items() if place.home in arc), None)
    if owner is None:
        return []
    slot = cluster.slot_of(owner)
    forbidden = blacklist_of(cluster.nodes[slot].disk)
    rule = cluster.watch.keeping.rules[place.scene, place.space]
    return [slot, *map(cluster.slot_of, holders(rule, place.home, owner, arcs, forbidden, line.keys() - arcs))]


def _span(arc: Arc) -> str:
    return f"{arc.first.hex()[:8]}… to {arc.last.hex()[:8]}…"
