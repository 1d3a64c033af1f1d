"""How healthy a cluster is, by what its nodes say of their copies: what is wrong, where, and what to do about it (specs/20-copies.md, Health). Pure.

Nodes count what they own, so that no record is counted twice. Who does not answer counts nothing: of what it owns nobody knows anything.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from scenefold.client.copy_reports import CopiesReport, LossReport
from scenefold.client.health import ClusterStatus, NodeState, shortages
from scenefold.client.own_warnings import strays_text
from scenefold.client.reports import NodeReport, ScrubReport
from scenefold.client.shortages import Shortage


class Condition(StrEnum):
    HEALTHY = "healthy"
    MENDING = "mending"
    """All copies are there, and something is on its way."""
    DEGRADED = "degraded"


@dataclass(frozen=True, slots=True)
class Ailment:
    """Something that is wrong at a node. `mends_itself`: nobody has to do anything but wait."""

    kind: str
    address: str
    text: str
    to_do: str
    degrades: bool = True
    mends_itself: bool = False

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known = {"kind": self.kind, "address": self.address or None, "text": self.text, "to_do": self.to_do}
        return {**known, "degrades": self.degrades, "mends_itself": self.mends_itself}


@dataclass(frozen=True, slots=True)
class ClusterHealth:
    """Made by `health_of`."""

    status: ClusterStatus
    ailments: tuple[Ailment, ...]

    @property
    def condition(self) -> Condition:
        if any(ailment.degrades for ailment in self.ailments):
            return Condition.DEGRADED
        return Condition.MENDING if self.ailments else Condition.HEALTHY

    @property
    def shortage(self) -> Shortage | None:
        """Where most copies fail for want of nodes; None if all could be there."""
        return max(shortages(self.status.nodes), key=lambda few: few.missing, default=None)

    @property
    def reports(self) -> list[CopiesReport]:
        return [node.report.copies for node in self.status.nodes if node.report is not None and node.report.copies is not None]

    @property
    def records(self) -> int:
        """All that the nodes that answer own."""
        return sum(copies.owned for copies in self.reports)

    @property
    def under_copied(self) -> int:
        """Records that lie on fewer nodes than they should."""
        return sum(copies.under_copied.records for copies in self.reports)

    @property
    def mis_placed(self) -> int:
        """Records with a copy where none should be: where placement put it before, or where a blacklist forbids it."""
        return sum(copies.mis_placed.records + copies.forbidden.records for copies in self.reports)

    @property
    def corrupt(self) -> int:
        """Records that have changed on a node's disk, and are not healed."""
        return sum(copies.rotten for copies in self.reports)

    @property
    def pending(self) -> int:
        """Records still to come: owed to nodes, also to those that do not answer, not settled yet, being compared, or being brought home."""
        return sum(pending_of(node.report) for node in self.status.nodes if node.report is not None)

    @property
    def unrecovered(self) -> int:
        """Pieces of the line of which it is not known yet what was acknowledged there."""
        return sum(copies.unrecovered for copies in self.reports)

    @property
    def kept_apart(self) -> int:
        """Records that nodes have brought along from before they were away, and that somebody with their scene's key has to look at."""
        return sum(node.report.kept_apart.records for node in self.status.nodes if node.report is not None)

    @property
    def losses(self) -> list[LossReport]:
        """What may be lost and nobody has acknowledged yet: each once, however many nodes tell it, the oldest first."""
        told = {loss.id: loss for copies in self.reports for loss in copies.lost}
        return sorted(told.values(), key=lambda loss: (loss.noted_s, loss.id))

    @property
    def seconds_to_health(self) -> float | None:
        """0 if nothing is wrong; None if somebody has to do something, or it is not known yet how much there is to be moved, or how fast."""
        if not self.ailments:
            return 0.0
        if any(not ailment.mends_itself or ailment.kind == "unrecovered" for ailment in self.ailments):
            return None
        times = [copies.repair.seconds if copies.repair.records else None for copies in self.reports if _is_at_work(copies)]
        known = [seconds for seconds in times if seconds is not None]
        return max(known) if known and len(known) == len(times) else None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "name": self.status.name,
            "status": str(self.condition),
            "nodes": [_node_document(node) for node in self.status.nodes],
            "records": self.records,
            "records_with_copies": sum(copies.copied for copies in self.reports),
            "under_copied": self.under_copied,
            "mis_placed": self.mis_placed,
            "corrupt": self.corrupt,
            "pending": self.pending,
            "unrecovered": self.unrecovered,
            "kept_apart": self.kept_apart,
            "lost": [loss.document() for loss in self.losses],
            "seconds_to_health": self.seconds_to_health,
            "ailments": [ailment.document() for ailment in self.ailments],
        }


def pending_of(report: NodeReport) -> int:
    """Of what a node owns, or holds in vain, how many copies and records are still to come to where they belong."""
    copies = report.copies
    return report.strays + (0 if copies is None else copies.owed + copies.unsettled + copies.comparing.records)


def health_of(status: ClusterStatus) -> ClusterHealth:
    """Everything that is wrong, what degrades first."""
    silent, members = [node.address for node in status.nodes if not node.alive], frozenset(node.address for node in status.nodes)
    found = [
        Ailment(warning.kind, warning.address, warning.text, _TO_DO.get(warning.kind, ""), mends_itself=warning.kind in _MENDS_ITSELF)
        for warning in status.warnings
        # How often damage was met is told there, and here what of it is not healed. What there are too few nodes for degrades here always.
        if warning.degrades and warning.kind not in ("damaged", _TOO_FEW)
    ]
    found += [Ailment(_TOO_FEW, few.address, few.text, few.to_do) for few in shortages(status.nodes)]
    for node in status.nodes:
        found += [_held_up(ailment, node) for ailment in _of_node(node, silent, members)]
    found += map(_lost, ClusterHealth(status, ()).losses)
    return ClusterHealth(status, tuple(sorted(found, key=lambda ailment: not ailment.degrades)))


_TO_DO = {
    "missing": "start it; if it is gone for ever, wait until it is removed: then others take over what it owned, as far as they have copies",
    "awaited": "start it, or take it off the line: scenectl cluster revoke",
    "no lease": "start the node that decides the cluster's log, or see what keeps it from answering",
    "gap": "start the nodes beside it that do not answer",
    "overlap": "look at both nodes' logs",
    "nearly full": "free its disk, give it more (node run --capacity), or add a node",
    "handover": "wait; if it lasts, look at both nodes' logs",
}
_MENDS_ITSELF = frozenset({"handover"})
_TOO_FEW = "too few nodes"
_WAIT = "wait: what is missing is copied"


_LOST = "lost"
_BRING_BACK = (
    "start these machines again with their disks, if there are any left: what they have they bring home; "
    "else restore what is missing, and say that you have seen this: scenectl cluster health --acknowledge"
)


def _lost(loss: LossReport) -> Ailment:
    what = "what was acknowledged last" if loss.complete_copy_left else "what was acknowledged"
    left = "too few of those that held it were left" if loss.complete_copy_left else "no complete copy of it was left"
    text = (
        f"{loss.noted_by}: {what} on {loss.share:.2%} of the line in spaces with {loss.copies} copies may be lost: "
        f"{left} when {_some(loss.removed)} had been removed"
    )
    return Ailment(_LOST, loss.noted_by, text, _BRING_BACK)


_RESTS = frozenset({"under-copied", "mis-placed", "comparing", "placing", "forbidden"})
"""What nobody mends while repair is paused."""


def _held_up(ailment: Ailment, node: NodeState) -> Ailment:
    if node.report is None or "repair" not in node.report.paused or ailment.kind not in _RESTS or not ailment.mends_itself:
        return ailment
    return replace(ailment, to_do=f"repair is paused there: scenectl node upkeep resume {node.address}", mends_itself=False)


def _of_node(node: NodeState, silent: list[str], members: frozenset[str]) -> Iterable[Ailment]:
    address = node.address
    if node.report is None:
        return
    copies = node.report.copies
    if copies is None:
        yield Ailment("unknown", address, f"{address} says nothing of copies", "let it run the same version as the others")
        return
    if copies.under_copied.records and (silent or not _is_explained(copies)):
        text = (
            f"{address}: {copies.under_copied.records:,} of {copies.copied:,} records lie on fewer nodes than they should, "
            f"up to {copies.missing_max} {'copy' if copies.missing_max == 1 else 'copies'} fewer"
        )
        waits = f"start {_some(silent)}, or wait until the cluster removes what stays silent; then others get copies"
        to_do = "see above" if copies.shortages else waits if silent else _WAIT
        yield Ailment("under-copied", address, text, to_do, mends_itself=not silent and not copies.shortages)
    elif copies.owed_to_silent:
        yield _owed(address, copies, members)
    if copies.forbidden.records:
        text = (
            f"{address}: copies of {copies.forbidden.records:,} records lie on {_some(copies.forbidden_on)}, where its blacklist forbids it"
        )
        yield Ailment(
            "forbidden", address, text, "add nodes that it allows" if copies.shortages else _WAIT, mends_itself=not copies.shortages
        )
    if copies.full:
        text = f"{address}: {_some(copies.full)} had no room for copies of what it owns; others hold them, as far as there are any"
        yield Ailment("no room", address, text, _TO_DO["nearly full"], degrades=False)
    if copies.rotten:
        healing = copies.rotten - copies.unhealed
        counts = [f"{healing:,} are being fetched from others"] if healing else []
        counts += [f"{copies.unhealed:,} could not be had from others, at the last try"] if copies.unhealed else []
        text = f"{address}: {copies.rotten:,} records have rotted on its disk: {', '.join(counts)}"
        to_do = (
            "write what is lost anew, or restore it; then look at the disk: scenectl node verify"
            if copies.unhealed
            else "wait; then look at its disk"
        )
        yield Ailment("rotten", address, text, to_do, mends_itself=not copies.unhealed)
    if copies.unrecovered:
        text = f"{address}: it does not know yet what was acknowledged on {copies.unrecovered_share:.1%} of the line, which it took over"
        to_do = (
            f"start {_some(silent)}, or wait until it is removed: every node is asked what it has"
            if silent
            else "wait: every node is asked"
        )
        yield Ailment("unrecovered", address, text, to_do, mends_itself=not silent)
    yield from _on_their_way(node, copies)


def _owed(address: str, copies: CopiesReport, members: frozenset[str]) -> Ailment:
    """What is to come to nodes that do not answer. To those that were removed nothing comes any more: nobody has to start them."""
    text = f"{address}: {copies.owed_to_silent:,} records are still to come to {_some(copies.silent)}, which it does not hear"
    left = [silent for silent in copies.silent if silent in members]
    if left or not copies.silent:
        return Ailment("owed", address, text, f"start {_some(left) or 'the nodes that are silent'}, or see what is between them")
    what = "was removed" if len(copies.silent) == 1 else "were removed"
    to_do = f"wait: what {_some(copies.silent)}, which {what}, was to get is owed no longer once others hold its copies"
    return Ailment("owed", address, text, to_do, degrades=False, mends_itself=True)


def _on_their_way(node: NodeState, copies: CopiesReport) -> Iterable[Ailment]:
    """What costs no copy, and ends by itself."""
    address = node.address

    def mending(kind: str, text: str) -> Ailment:
        return Ailment(kind, address, f"{address}: {text}", "wait", degrades=False, mends_itself=True)

    if copies.under_copied.segments and not copies.under_copied.records and not _is_explained(copies):
        yield mending("placing", "who is to hold copies of a part of its arc, where there are no records yet, is being settled")
    if copies.mis_placed.records:
        yield mending(
            "mis-placed", f"copies of {copies.mis_placed.records:,} records move to other nodes; until then the former ones count"
        )
    if copies.comparing.records:
        yield mending("comparing", f"{copies.comparing.records:,} records that it took over are being compared with their copies")
    if copies.owed > copies.owed_to_silent:
        yield mending("pending", f"{copies.owed - copies.owed_to_silent:,} copies are on their way")
    if copies.unsettled:
        yield mending("unsettled", f"{copies.unsettled:,} records wait until enough nodes have them")
    if node.report is not None and node.report.strays:
        yield mending("strays", f"{strays_text(node.report)} records that belong elsewhere are being brought home")


def _is_explained(copies: CopiesReport) -> bool:
    """Whether no record lacks more copies than there are too few nodes for, which is told with what to do."""
    return copies.missing_max <= max((short.copies - short.possible for short in copies.shortages), default=0)


def _is_at_work(copies: CopiesReport) -> bool:
    return bool(copies.under_copied.records or copies.mis_placed.records or copies.forbidden.records or copies.repair.records)


def _some(addresses: Iterable[str]) -> str:
    listed = list(addresses)
    return ", ".join(listed[:4]) + (f" and {len(listed) - 4} others" if len(listed) > 4 else "")


def _node_document(node: NodeState) -> dict[str, Any]:
    report = node.report
    copies = None if report is None or report.copies is None else report.copies.document()
    known = {"address": node.address, "alive": node.alive, "share": node.share, "copies": copies}
    if report is None:
        return {**known, "paused": None, "damaged": None, "strays": None, "strays_more": None, "kept_apart": None, "scrub": None}
    apart, known["paused"] = report.kept_apart.document(), list(report.paused)
    strays = {"strays": report.strays, "strays_more": report.strays_more}
    return {**known, "damaged": report.damaged, **strays, "kept_apart": apart, "scrub": _scrub_document(report.scrub)}


def _scrub_document(scrub: ScrubReport | None) -> dict[str, Any] | None:
    if scrub is None:
        return None
    known = {"round": scrub.round, "fraction": scrub.fraction, "seconds_left": scrub.seconds_left}
    return {**known, "rotten": scrub.rotten, "rotten_before": scrub.rotten_before, "paused": scrub.paused}
