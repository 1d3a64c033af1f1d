"""A cluster looked at as a whole: what all nodes say of themselves, laid side by side, and what is off about it. Pure.

Reports are made one after another, and bounds move in between. So a gap or an overlap that a handover explains is none, and whoever looks
asks once more before it believes another one (`is_unsteady`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from scenefold.base.cover import without
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Arc, Location
from scenefold.client.own_warnings import Concern, own_warnings
from scenefold.client.removals import RemovedNode
from scenefold.client.reports import HandoverReport, NodeReport
from scenefold.client.shortages import Shortage, rules_of, shortages_of

NEVER_CAME = bytes(16)
"""The incarnation of a founder that never registered."""


@dataclass(frozen=True, slots=True)
class NodeState:
    """One node on the line. `report` is what it says of itself; None if it does not answer: then `problem` says why."""

    address: str
    incarnation: bytes
    is_voter: bool
    known_arc: Arc | None
    """Its arc as the asked node knows it; of a silent one without what living nodes own."""
    heard_s: float | None
    """Seconds since the asked node has heard of it; None: never."""
    report: NodeReport | None
    problem: str = ""
    blacklist: tuple[str, ...] = ()
    """Addresses, and prefixes of some, of nodes that must not hold copies of its data: by its own word, else as the asked node knows it."""
    blacklist_version: int = 0
    last: NodeReport | None = None
    """Of a node that does not answer now: what it said last, to somebody who looks again and again."""
    last_s: float = 0.0
    """How long ago that was."""

    @property
    def alive(self) -> bool:
        return self.report is not None

    @property
    def arc(self) -> Arc | None:
        """What it owns: by its own word, else by what was heard last."""
        return self.known_arc if self.report is None else self.report.arc

    @property
    def share(self) -> float:
        """Part of the line that it owns."""
        return 0.0 if self.arc is None else self.arc.length / LINE_LENGTH

    @property
    def role(self) -> str:
        """voter, member, joining, draining; awaited: a founder that never came."""
        if self.report is not None:
            return self.report.role
        return "voter" if self.is_voter else "awaited" if self.incarnation == NEVER_CAME else "member"

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        report = self.report
        return {
            "address": self.address,
            "id": int(node_id_of(self.address)),
            "alive": self.alive,
            "role": self.role,
            "trusted": None if report is None else report.trusted,
            "arc": None if self.arc is None else {"first": self.arc.first.hex(), "last": self.arc.last.hex()},
            "right_bound": None if self.arc is None else self.arc.last.hex(),
            "share": self.share,
            **stored_document(report),
            "heard_s": self.heard_s,
            "lease_s": None if report is None else report.lease_s,
            "log_position": None if report is None else report.log_position,
            "handovers": None if report is None else [handover_document(handover) for handover in report.handovers],
            "strays": None if report is None else report.strays,
            "strays_more": None if report is None else report.strays_more,
            "rays_per_second": None if report is None else report.rays_per_second,
            "connections_turned_away": None if report is None else report.turned_away,
            "datagrams_dropped": None if report is None else report.dropped,
            "incarnation": self.incarnation.hex() if report is None else report.incarnation,
            "boot": None if report is None else report.boot,
            "blacklist": list(self.blacklist),
            "blacklist_version": self.blacklist_version,
        }


def stored_document(report: NodeReport | None) -> dict[str, Any]:
    """What a node holds, as a part of its JSON form; nulls if it does not say."""
    return {
        "records": None if report is None else report.records,
        "bytes": None if report is None else report.bytes,
        "disk_bytes_used": None if report is None else report.used_bytes,
        "capacity_bytes": None if report is None else report.capacity_bytes,
        "disk_fraction": None if report is None else round(report.fill, 4),
        "memory_fraction": None if report is None else round(report.memory_fraction, 4),
    }


def handover_document(handover: HandoverReport) -> dict[str, Any]:
    """The JSON form of a handover (docs/reference/scenectl.md)."""
    return {
        "id": handover.id,
        "step": handover.step,
        "gives": handover.gives,
        "peer": handover.peer,
        "peer_removed": handover.peer_removed,
        "first": handover.piece.first.hex(),
        "last": handover.piece.last.hex(),
        "seconds": handover.seconds,
        "records": handover.records,
        "bytes": handover.bytes,
    }


@dataclass(frozen=True, slots=True)
class ClusterStatus:
    """All nodes in the order of the line, as seen by `asked` and by themselves."""

    name: str
    asked: str
    nodes: tuple[NodeState, ...]
    warnings: tuple[Concern, ...]
    removed: tuple[RemovedNode, ...] = ()
    """Of nodes that are not on the line any more: the last removal of each, newest first."""

    @property
    def degraded(self) -> bool:
        """True if a node does not answer, or a part of the line cannot be served."""
        return any(warning.degrades for warning in self.warnings)

    @property
    def is_unsteady(self) -> bool:
        """Whether something may look off only because nodes were asked one after another."""
        return any(warning.kind in ("gap", "overlap", "behind", "deaf") for warning in self.warnings)

    @property
    def best_informed(self) -> NodeId:
        """The node that knows the cluster's log furthest."""
        # By where it was asked: what it calls itself is nobody's id, perhaps.
        return max((node.report.log_position, node_id_of(node.address)) for node in self.nodes if node.report is not None)[1]

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "name": self.name,
            "asked": self.asked,
            "degraded": self.degraded,
            "nodes": [node.document() for node in self.nodes],
            "warnings": [warning.document() for warning in self.warnings],
            "removed": [removed.document() for removed in self.removed],
        }


def judged(name: str, asked: str, nodes: Sequence[NodeState]) -> ClusterStatus:
    """The cluster with everything that is off about it."""
    nodes = [_trimmed(node, nodes) for node in nodes]
    newest = max((node.report.log_position for node in nodes if node.report is not None), default=0)
    warnings = [*_absences(nodes), *voter_warnings(nodes), *line_warnings(nodes)]
    for node in nodes:
        if node.report is not None:
            warnings += own_warnings(node.address, node.report, newest)
    warnings += [Concern("too few nodes", few.text, few.forbids_writes, few.address) for few in shortages(nodes)]
    warnings += _deafness(nodes)
    return ClusterStatus(name, asked, tuple(nodes), tuple(warnings))


def shortages(nodes: Sequence[NodeState]) -> list[Shortage]:
    """Where fewer copies can be than there shall be."""
    told = [(node.address, node.report.copies) for node in nodes if node.report is not None and node.report.copies is not None]
    addresses = [node.address for node in nodes]
    blacklists = {node.address: node.blacklist for node in nodes}
    return shortages_of(
        told,
        awaited=sum(node.report is None and node.incarnation == NEVER_CAME for node in nodes),
        idle=[node.address for node in nodes if node.report is not None and node.report.arc is None],
        rules=lambda address: rules_of(address, blacklists[address], addresses),
    )


def _trimmed(node: NodeState, nodes: Sequence[NodeState]) -> NodeState:
    """A silent node without what living ones say they own: it may have died before it told of what it gave away."""
    if node.report is not None or node.known_arc is None:
        return node
    pieces = [node.known_arc]
    for other in nodes:
        if other.report is not None:
            pieces = [rest for piece in pieces for rest in without(piece, other.report.arc)]
    # Pieces are given away at the ends, so what is left is one; more than one only if somebody lies.
    return replace(node, known_arc=max(pieces, key=lambda piece: piece.length, default=None))


def voter_warnings(nodes: Sequence[NodeState]) -> Iterable[Concern]:
    """Of several who decide the cluster's log: what their number and their silence mean."""
    voters = [node for node in nodes if node.is_voter]
    away = [node.address for node in voters if not node.alive]
    preparing = [node.address for node in voters if node.alive and node.report is not None and not node.report.grants_leases]
    if len(voters) > 1 and preparing:
        does = "does" if len(preparing) == 1 else "do"
        what = f"{', '.join(preparing)}, new among those who decide the cluster's log, {does} not grant leases yet"
        yield Concern("voters", f"{what}: none of them may be lost before, and those that are away must come back", False, preparing[0])
    if len(voters) > 1 and len(voters) % 2 == 0:
        what = f"{len(voters)} nodes decide the cluster's log: an even number stands no more losses than one fewer"
        yield Concern("voters", f"{what}; add one (`scenectl cluster add-voter`), or remove one", False, voters[0].address)
    if len(voters) > 1 and away:
        spare = (len(voters) - 1) // 2 - len(away)
        rest = f"{spare} more may be lost" if spare > 0 else "none more may be lost" if spare == 0 else "nothing can be decided"
        what = f"of {len(voters)} nodes that decide the cluster's log {', '.join(away)} {'is' if len(away) == 1 else 'are'} away"
        yield Concern("voters", f"{what}: {rest}", spare < 0, away[0])


def _absences(nodes: Sequence[NodeState]) -> Iterable[Concern]:
    is_alone = sum(node.is_voter for node in nodes) == 1
    for node in nodes:
        if node.report is None:
            kind, what = ("awaited", "has never come") if node.role == "awaited" else ("missing", "does not answer")
            consequence = "; nobody can join or be removed meanwhile" if node.is_voter and is_alone else ""
            yield Concern(kind, f"{node.address} {what}{consequence}: {node.problem}", True, node.address)


def _deafness(nodes: Sequence[NodeState]) -> Iterable[Concern]:
    """Nodes that answer us and that another one does not hear: a cut in one direction, often."""
    alive = {node.address for node in nodes if node.alive}
    for node in nodes:
        peers = {} if node.report is None else node.report.peers
        deaf_to = [address for address, peer in peers.items() if address in alive and not peer.alive]
        if deaf_to:
            yield Concern("deaf", f"{node.address} does not hear {_some(deaf_to)}, and we do", False, node.address)


def line_warnings(nodes: Sequence[NodeState]) -> list[Concern]:
    """Where the line is not owned exactly once. Nodes in the order of the log."""
    handed = [handover.piece for node in nodes if node.report is not None for handover in node.report.handovers]
    # What a silent node owns by now nobody can say.
    owning = [(node, node.arc) for node in nodes if node.arc is not None]
    found: list[Concern] = []
    free: Location | None = FIRST
    before: NodeState | None = None
    for node, arc in owning:
        assert arc is not None
        if free is None or arc.first < free:
            twice = Arc(arc.first, min(arc.last, _before(free)))
            is_certain = node.alive and before is not None and before.alive
            if is_certain and not _is_within(twice, handed):
                assert before is not None
                found.append(Concern("overlap", f"{before.address} and {node.address} both own {_piece(twice)}", True, node.address))
        elif arc.first > free and not _is_within(gap := Arc(free, _before(arc.first)), handed):
            beside = nodes[0 if before is None else nodes.index(before) : nodes.index(node) + 1]
            found.append(Concern("gap", _unowned(f"{_piece(gap)}, left of {node.address}", beside), True, node.address))
        if free is not None and arc.last >= free:
            free, before = arc.last.next(), node
    if free is not None and not _is_within(rest := Arc(free, LAST), handed):
        beside = nodes[0 if before is None else nodes.index(before) :]
        found.append(Concern("gap", _unowned(f"{_piece(rest)}, at the end of the line", beside), True))
    return found


def _unowned(place: str, beside: Sequence[NodeState]) -> str:
    """`beside`: who may own the place, by the order of the line. A silent one may have taken it just before it fell silent."""
    silent = [node for node in beside if not node.alive]
    if not silent:
        return f"nobody owns {place}"
    verb, them, their = ("does", "it", "its") if len(silent) == 1 else ("do", "them", "their")
    # The voter is never removed.
    or_wait = "" if any(node.is_voter for node in silent) else f", or wait for {their} removal"
    who = _some([node.address for node in silent])
    return f"nobody who answers owns {place}; {who}, which {verb} not answer, may: start {them}{or_wait}"


def _is_within(piece: Arc, handed: Sequence[Arc]) -> bool:
    return any(other.first <= piece.first and piece.last <= other.last for other in handed)


def _before(place: Location | None) -> Location:
    """The location before a place; the last one before the end of the line."""
    return LAST if place is None else Location.from_number(place.number - 1)


def _piece(arc: Arc) -> str:
    return f"{arc.first.hex()[:8]}..{arc.last.hex()[:8]} ({arc.length / LINE_LENGTH:.2%} of the line)"


def _some(addresses: Sequence[str]) -> str:
    return ", ".join(addresses[:4]) + (f" and {len(addresses) - 4} others" if len(addresses) > 4 else "")
